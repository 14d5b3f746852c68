"""Files for ParaView: material points and grid as series of VTU files with their times."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from ..common import tensors
from ..common.checks import whole
from ..common.files import complete, failing_together, named
from .fields import Frame, Piece, grid_frame, grid_piece, points_piece, stress_piece
from .vtu_file import HEXAHEDRON, QUAD, VERTEX, write, write_index

_STEP = re.compile(r"""_(\d+)\.p?vtu["']/>""")
FAILED = "snapshot not written"
_CELL = {2: QUAD, 3: HEXAHEDRON}


class Snapshots:
    """Recorder that writes the material points and the grid, now and after every ``every`` steps.

    ``path``: folder and first part of the names; missing folders are made.  Open in ParaView

    - ``<path>_points.pvd``, of ``<path>_points_000020.vtu``, …: velocity (m/s), stress, mean_stress
      (tension positive) and von_mises q (Pa), volume (m³), density (kg/m³), half (m; half the
      support domain), body (number from 0), on several ranks the points' number, and whatever else
      the points carry as one row a point (NaN in a body that does not carry it);
    - ``<path>_grid.pvd``, of ``<path>_grid_000020.vtu``, …: the fields of ``run.grid_fields()`` on
      nodes and cells;
    - with ``grid_stress``, ``<path>_stress.pvd``, of ``<path>_stress_000020.vtu``, …: the stress on
      the grid (``run.stress_field``), its mean and von Mises q, in the cells that hold material,
      each with corners of its own, for that field jumps from cell to cell.

    Stress is (xx, yy, zz, xy, yz, xz) as ParaView labels it; yz and xz are zero in plane strain, as
    are z and the third component of vectors.  Numbers are written as the run has them, to the last
    bit and not compressed: 165 bytes a point of an elastic body in dynamics.  On several ranks each
    writes a piece of its own, ``<path>_points/<path>_points_000020_p0001.vtu`` on rank 1 and none
    where it has nothing, points and cells once each; the collection names files
    ``<path>_points_000020.pvtu``, …, which name the pieces.  Each file replaces its forerunner only
    when complete, and is named only when it is there, so a run that dies leaves a series that
    opens.  What another number of ranks has written of the same step goes once it is replaced.

    Raises ``ValueError`` for a ``path`` without name, ``every`` < 1, a ``grid_stress`` that is no
    bool or a second run; ``OSError``
    naming the path on every rank, when attached or later, where nothing can be written (to which
    the run adds its step and time).
    """

    def __init__(self, path: str | os.PathLike, every: int = 1, grid_stress: bool = False):
        self.path, self.every = named(path), whole("every", every)
        if grid_stress not in (True, False):
            raise ValueError(f"grid_stress must be True or False, got {grid_stress!r}")
        self.kinds = ("points", "grid", *(["stress"] if grid_stress else []))
        self._frame: tuple | None = None

    def attach(self, run) -> None:
        """Make the folder and write the state now."""
        if self._frame is not None:
            raise ValueError(
                f"path {str(self.path)!r} is recorded already: take new Snapshots for another run"
            )
        self._series = {
            kind: _Series(self.path.with_name(f"{self.path.name}_{kind}")) for kind in self.kinds
        }
        frame = grid_frame(run.grid)
        with failing_together(run.grid.comm, FAILED, self.path):
            if run.grid.comm.rank == 0:
                self.path.parent.mkdir(parents=True, exist_ok=True)
        self._write(run, frame)
        self._frame = frame

    def __call__(self, run) -> None:
        """Write the state after a step, if it is its turn."""
        if run.steps % self.every == 0:
            self._write(run, self._frame)

    def moved(self, run) -> None:
        """Nodes and cells are on other ranks."""
        self._frame = grid_frame(run.grid)

    def _write(self, run, frame: Frame) -> None:
        comm, cell = run.grid.comm, _CELL[run.grid.dim]
        pieces = {}
        if run.bodies:
            pieces["points"] = points_piece(run.bodies, comm), VERTEX
        pieces["grid"] = grid_piece(run, frame), cell
        if "stress" in self._series:
            pieces["stress"] = stress_piece(run.stress_field()), cell
        for kind, (piece, cell_type) in pieces.items():
            self._series[kind].add(run, self.path, piece, cell_type)

    @property
    def label(self) -> str:
        """Its name in a checkpoint."""
        return f"Snapshots {self.path.name}"

    def state(self) -> dict[str, np.ndarray]:
        """The files written so far and their times, which a restart lists again."""
        return {
            series.path.name: np.frombuffer(series.entries.encode(), np.uint8)
            for series in self._series.values()
        }

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on with the collections of a checkpoint."""
        for series in self._series.values():
            series.go_on_from(state[series.path.name].tobytes().decode())


class _Series:
    """Files of one kind, and the collection that names them with their times."""

    def __init__(self, path: Path):
        self.path = path
        self.entries = ""

    def add(self, run, shown: Path, piece: Piece, cell_type: int) -> None:
        """Write the file of each rank, then the one that names them, then the collection with it.

        Raises ``OSError`` naming ``shown``, on all ranks.  Collective.
        """
        comm, dim = run.grid.comm, piece.x.shape[1]
        x = _widened(piece.x, 3)
        fields = [
            {name: _vtk(value, dim) for name, value in data.items()}
            for data in (piece.point_data, piece.cell_data)
        ]
        name = f"{self.path.name}_{run.steps:06d}"
        file = self.path.with_name(f"{name}.{'vtu' if comm.size == 1 else 'pvtu'}")
        files = {comm.rank: file.name}
        if comm.size > 1:  # meshio cannot read a piece of nothing, so there is none
            ranks = [rank for rank, cells in enumerate(comm.allgather(len(piece.cells))) if cells]
            files = {rank: f"{self.path.name}/{name}_p{rank:04d}.vtu" for rank in ranks or [0]}
        with failing_together(comm, FAILED, shown):
            if comm.rank in files:
                if comm.size > 1:
                    self.path.mkdir(exist_ok=True)
                with complete(self.path.parent / files[comm.rank]) as part:
                    write(part, x, piece.cells, cell_type, *fields)
        entry = f'<DataSet timestep="{float(run.time)!r}" file={quoteattr(file.name)}/>\n'
        with failing_together(comm, FAILED, shown):
            if comm.rank == 0:
                before = self._forerunners(name)
                if comm.size > 1:
                    with complete(file) as part:
                        write_index(part, files.values(), x, *fields)
                self._list(self.entries + entry)
                for old in before - {file, *(file.parent / piece for piece in files.values())}:
                    with suppress(OSError):
                        old.unlink()
        self.entries += entry

    def go_on_from(self, entries: str) -> None:
        """List ``entries`` of a checkpoint, but for those of steps that have been written since:
        files of another number of ranks have other names."""
        named = {_STEP.search(entry)[1]: entry for entry in self.entries.splitlines(keepends=True)}
        self.entries = "".join(
            named.get(_STEP.search(entry)[1], entry) for entry in entries.splitlines(keepends=True)
        )

    def _forerunners(self, name: str) -> set[Path]:
        """Files of one step that are there."""
        one, index = (self.path.with_name(f"{name}.{kind}") for kind in ("vtu", "pvtu"))
        found = {file for file in (one, index) if file.exists()}
        if index in found:
            with suppress(OSError, ElementTree.ParseError):
                pieces = ElementTree.parse(index).iter("Piece")
                names = {Path(piece.get("Source", "")).name for piece in pieces}
                found |= {self.path / file for file in names if file.startswith(f"{name}_p")}
        return found

    def _list(self, entries: str) -> None:
        """Write the collection."""
        with complete(self.path.with_name(self.path.name + ".pvd")) as part:
            part.write_text(
                '<?xml version="1.0" encoding="utf-8"?>\n<VTKFile type="Collection" '
                'version="0.1">\n'
                f"<Collection>\n{entries}</Collection>\n</VTKFile>\n",
                encoding="utf-8",
            )


def _vtk(value: np.ndarray, dim: int) -> np.ndarray:
    """Rows as VTK takes them: three components of a vector, six of a symmetric tensor."""
    if value.ndim > 2:
        return value.reshape(len(value), int(np.prod(value.shape[1:])))
    if value.ndim == 2:
        return _widened(value, {dim: 3, tensors.components(dim): 6}.get(value.shape[1]))
    return value


def _widened(rows: np.ndarray, width: int | None) -> np.ndarray:
    """Rows (n, width), with zeros for what rows (n, k) lack."""
    if width in (None, rows.shape[1]):
        return rows
    wide = np.zeros((len(rows), width), rows.dtype)
    wide[:, : rows.shape[1]] = rows
    return wide
