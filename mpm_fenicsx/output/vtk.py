"""Files for ParaView: material points and grid as series of VTU files with their times."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from ..common import tensors
from ..common.checks import whole
from ..common.files import complete, failing_together, named
from .fields import whole_cloud, whole_fields, whole_grid, whole_stress
from .vtu_file import HEXAHEDRON, QUAD, VERTEX, write

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
    bit and not compressed: 165 bytes a point of an elastic body in dynamics.  Several ranks write
    one file, without ghosts.  Each file replaces its forerunner only when complete, so a run that
    dies leaves a series that opens.

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
        frame = whole_grid(run.grid)
        with failing_together(run.grid.comm, "snapshot not written", self.path):
            if run.grid.comm.rank == 0:
                self.path.parent.mkdir(parents=True, exist_ok=True)
        self._write(run, frame)
        self._frame = frame

    def __call__(self, run) -> None:
        """Write the state after a step, if it is its turn."""
        if run.steps % self.every == 0:
            self._write(run, self._frame)

    def _write(self, run, frame: tuple) -> None:
        comm = run.grid.comm
        cloud = whole_cloud(run.bodies, comm) if run.bodies else None
        fields = whole_fields(run)
        stress = whole_stress(run.stress_field()) if "stress" in self._series else None
        with failing_together(comm, "snapshot not written", self.path):
            if comm.rank == 0:
                dim = run.grid.dim
                if cloud:
                    x, values = cloud
                    vertices = np.arange(len(x), dtype=np.int32)[:, None]
                    self._series["points"].add(run, x, vertices, VERTEX, values, {})
                self._series["grid"].add(run, *frame, _CELL[dim], *fields)
                if stress:
                    x, cells, values = stress
                    self._series["stress"].add(run, x, cells, _CELL[dim], values, {})

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
            series.entries = state[series.path.name].tobytes().decode()


class _Series:
    """VTU files of one kind, and the collection that names them with their times."""

    def __init__(self, path: Path):
        self.path = path
        self.entries = ""

    def add(
        self,
        run,
        x: np.ndarray,
        cells: np.ndarray,
        cell_type: int,
        point_data: Mapping,
        cell_data: Mapping,
    ) -> None:
        """Write one file, then the collection with it."""
        dim = x.shape[1]
        fields = (
            {name: _vtk(value, dim) for name, value in data.items()}
            for data in (point_data, cell_data)
        )
        file = self.path.with_name(f"{self.path.name}_{run.steps:06d}.vtu")
        with complete(file) as part:
            write(part, _widened(x, 3), cells, cell_type, *fields)
        entries = (
            f'{self.entries}<DataSet timestep="{float(run.time)!r}" file={quoteattr(file.name)}/>\n'
        )
        with complete(self.path.with_name(self.path.name + ".pvd")) as part:
            part.write_text(
                '<?xml version="1.0" encoding="utf-8"?>\n<VTKFile type="Collection" '
                'version="0.1">\n'
                f"<Collection>\n{entries}</Collection>\n</VTKFile>\n",
                encoding="utf-8",
            )
        self.entries = entries


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
