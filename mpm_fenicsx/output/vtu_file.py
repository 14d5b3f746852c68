"""VTU files: VTK's XML for unstructured grids, with the arrays behind it as they are in memory, and
PVTU files that name the pieces of several ranks.

A snapshot of 100,000 points takes four times as long through meshio's text of base64, and twenty
times with its compression, for half the bytes on the disk.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

VERTEX, QUAD, HEXAHEDRON = 1, 9, 12
"""VTK's numbers of the types of cells."""

_KIND = {"f": "Float", "i": "Int", "u": "UInt"}


def write(
    path: Path,
    x: np.ndarray,
    cells: np.ndarray,
    cell_type: int,
    point_data: Mapping[str, np.ndarray],
    cell_data: Mapping[str, np.ndarray],
) -> None:
    """Write points x (n, 3), m, cells (m, corners) of one type, and fields (n, …) and (m, …) by
    name.

    Raises ``OSError`` where it cannot be written, ``ValueError`` naming a field that is not of
    real numbers.
    """
    corners = cells.shape[1]
    topology = {
        "connectivity": cells.ravel(),
        "offsets": np.arange(corners, corners * len(cells) + 1, corners, dtype=cells.dtype),
        "types": np.full(len(cells), cell_type, dtype=np.uint8),
    }
    sections = {
        section: {name: _little_endian(name, values) for name, values in arrays.items()}
        for section, arrays in {
            "Points": {"Points": x},
            "Cells": topology,
            "PointData": point_data,
            "CellData": cell_data,
        }.items()
    }
    blocks = [block for arrays in sections.values() for block in arrays.values()]
    blocks.reverse()  # so that meshio 5.3 finds them: it mixes up arrays that are in order
    offset = sum(8 + block.nbytes for block in blocks)
    header = []
    for section, arrays in sections.items():
        header.append(f"<{section}>")
        for name, block in arrays.items():
            offset -= 8 + block.nbytes
            header.append(f'<DataArray {_kind(name, block)} format="appended" offset="{offset}"/>')
        header.append(f"</{section}>")
    with open(path, "wb") as file:
        file.write(
            '<?xml version="1.0" encoding="utf-8"?>\n<VTKFile type="UnstructuredGrid" '
            'version="1.0" byte_order="LittleEndian" header_type="UInt64">\n<UnstructuredGrid>\n'
            f'<Piece NumberOfPoints="{len(x)}" NumberOfCells="{len(cells)}">\n'.encode()
            + "\n".join(header).encode()
            + b'\n</Piece>\n</UnstructuredGrid>\n<AppendedData encoding="raw">\n_'
        )
        for block in blocks:
            file.write(np.array(block.nbytes, dtype="<u8"))
            file.write(block)
        file.write(b"\n</AppendedData>\n</VTKFile>\n")


def write_index(
    path: Path,
    pieces: Iterable[str],
    x: np.ndarray,
    point_data: Mapping[str, np.ndarray],
    cell_data: Mapping[str, np.ndarray],
) -> None:
    """Write the PVTU file of VTU files ``pieces``, named as seen from its folder, which have arrays
    of the same names, types and widths as ``x`` and the fields."""
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        '<VTKFile type="PUnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64">',
        '<PUnstructuredGrid GhostLevel="0">',
    ]
    sections = {"PPoints": {"Points": x}, "PPointData": point_data, "PCellData": cell_data}
    for section, arrays in sections.items():
        lines.append(f"<{section}>")
        for name, values in arrays.items():
            lines.append(f"<PDataArray {_kind(name, _little_endian(name, values[:0]))}/>")
        lines.append(f"</{section}>")
    lines += [f"<Piece Source={quoteattr(piece)}/>" for piece in pieces]
    lines += ["</PUnstructuredGrid>", "</VTKFile>", ""]
    path.write_text("\n".join(lines), encoding="utf-8")


def _kind(name: str, block: np.ndarray) -> str:
    """What the XML says of an array."""
    components = f' NumberOfComponents="{block.shape[1]}"' if block.ndim == 2 else ""
    number = f"{_KIND[block.dtype.kind]}{8 * block.dtype.itemsize}"
    return f'type="{number}" Name={quoteattr(name)}{components}'


def _little_endian(name: str, values: np.ndarray) -> np.ndarray:
    """The values, (n,) or (n, components), in the order of bytes that the file has."""
    values = np.asarray(values)
    if values.dtype.kind == "b":
        values = values.astype(np.int8)
    if values.dtype.kind not in _KIND or values.dtype.itemsize > 8:
        raise ValueError(f"{name} must be real numbers of at most 64 bits, got {values.dtype}")
    if values.dtype == np.float16:
        values = values.astype(np.float32)
    return np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
