"""VTU files, and PVTU files with their pieces, as VTK's own readers and meshio give them."""

import xml.etree.ElementTree as ET
from pathlib import Path

import meshio
import numpy as np
import pytest

VERTEX, QUAD, HEXAHEDRON = 1, 9, 12


class ByVTK:
    """A file as VTK's own reader gives it; a warning or error of VTK fails the test."""

    def __init__(self, path):
        vtk = pytest.importorskip("vtkmodules.vtkIOXML", reason="VTK is not installed")
        from vtkmodules.util.numpy_support import vtk_to_numpy

        errors, path = [], Path(path)
        if path.suffix == ".pvtu":
            reader = vtk.vtkXMLPUnstructuredGridReader()
        else:
            reader = vtk.vtkXMLUnstructuredGridReader()
        for event in ("ErrorEvent", "WarningEvent"):
            reader.AddObserver(event, lambda _, name: errors.append(name))
        reader.SetFileName(str(path))
        reader.Update()
        grid = reader.GetOutput()
        assert not errors and grid.GetNumberOfPoints()

        def fields(data):
            arrays = [data.GetArray(k) for k in range(data.GetNumberOfArrays())]
            return {array.GetName(): vtk_to_numpy(array) for array in arrays}

        self.x = vtk_to_numpy(grid.GetPoints().GetData())
        self.types = {grid.GetCellType(k) for k in range(grid.GetNumberOfCells())}
        connectivity = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
        self.cells = connectivity.reshape(grid.GetNumberOfCells(), -1)
        self.point_data, self.cell_data = fields(grid.GetPointData()), fields(grid.GetCellData())


class ByMeshio:
    """A file as meshio gives it; pieces, which it does not put together, one after the other."""

    def __init__(self, path):
        meshes = [meshio.read(piece) for piece in pieces(Path(path))]
        first = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
        blocks = [mesh.cells[0] for mesh in meshes]
        (kind,) = {block.type for block in blocks}
        self.types = {{"vertex": VERTEX, "quad": QUAD, "hexahedron": HEXAHEDRON}[kind]}
        self.x = np.concatenate([mesh.points for mesh in meshes])
        self.cells = np.concatenate([b.data + n for b, n in zip(blocks, first, strict=False)])
        points = [mesh.point_data or {} for mesh in meshes]
        cells = [{name: rows[0] for name, rows in mesh.cell_data.items()} for mesh in meshes]
        self.point_data, self.cell_data = together(points), together(cells)


def pieces(path: Path) -> list[Path]:
    """The VTU files behind a file."""
    if path.suffix != ".pvtu":
        return [path]
    return [path.parent / piece.get("Source") for piece in ET.parse(path).iter("Piece")]


def together(parts: list[dict]) -> dict:
    """Fields of pieces, all of the same names, one after the other."""
    assert len({tuple(fields) for fields in parts}) == 1
    return {name: np.concatenate([fields[name] for fields in parts]) for name in parts[0]}
