"""Files for ParaView: material points and grid as series of VTU files with their times."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

from mpi4py import MPI

import numpy as np

from ..common import tensors
from ..common.checks import whole
from ..common.files import complete, failing_together, named
from ..grid import dolfinx_versions

_RING = {2: [0, 1, 3, 2], 3: [0, 1, 3, 2, 4, 5, 7, 6]}  # tensor order to VTK's
_MIRROR = {2: [0, 2, 1, 3], 3: [0, 2, 1, 3, 4, 6, 5, 7]}  # first two reference axes exchanged
_CELL = {2: "quad", 3: "hexahedron"}
_LEFT_OUT = {"x", "mass", "acceleration", "exposed"}


class Snapshots:
    """Recorder that writes the material points and the grid, now and after every ``every`` steps.

    ``path``: folder and first part of the names; missing folders are made.  Open in ParaView

    - ``<path>_points.pvd``, of ``<path>_points_000020.vtu``, …: velocity (m/s), stress, mean_stress
      (tension positive) and von_mises q (Pa), volume (m³), density (kg/m³), half (m; half the
      support domain), body (number from 0), and whatever else the points carry as one row a point
      (NaN in a body that does not carry it);
    - ``<path>_grid.pvd``, of ``<path>_grid_000020.vtu``, …: the fields of ``run.grid_fields()`` on
      nodes and cells.

    Stress is (xx, yy, zz, xy, yz, xz) as ParaView labels it; yz and xz are zero in plane strain, as
    are z and the third component of vectors.  Several ranks write one file, without ghosts.  Each
    file replaces its forerunner only when complete, so a run that dies leaves a series that opens.

    Raises ``ValueError`` for a ``path`` without name, ``every`` < 1 or a second run; ``OSError``
    naming the path on every rank, when attached or later, where nothing can be written (to which
    the run adds its step and time).
    """

    def __init__(self, path: str | os.PathLike, every: int = 1):
        self.path, self.every = named(path), whole("every", every)
        self._frame: tuple | None = None

    def attach(self, run) -> None:
        """Make the folder and write the state now."""
        if self._frame is not None:
            raise ValueError(
                f"path {str(self.path)!r} is recorded already: take new Snapshots for another run"
            )
        self._points, self._grid = (
            _Series(self.path.with_name(f"{self.path.name}_{kind}")) for kind in ("points", "grid")
        )
        frame = _whole_grid(run.grid)
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
        cloud = _whole_cloud(run.bodies, comm) if run.bodies else None
        fields = _whole_fields(run)
        with failing_together(comm, "snapshot not written", self.path):
            if comm.rank == 0:
                dim = run.grid.dim
                if cloud:
                    x, values = cloud
                    self._points.add(
                        run, x, ("vertex", np.arange(len(x))[:, None]), values, {}, dim
                    )
                x, cells = frame
                self._grid.add(run, x, (_CELL[dim], cells), *fields, dim)

    @property
    def label(self) -> str:
        """Its name in a checkpoint."""
        return f"Snapshots {self.path.name}"

    def state(self) -> dict[str, np.ndarray]:
        """The files written so far and their times, which a restart lists again."""
        return {
            series.path.name: np.frombuffer(series.entries.encode(), np.uint8)
            for series in (self._points, self._grid)
        }

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on with the collections of a checkpoint."""
        for series in (self._points, self._grid):
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
        cells: tuple[str, np.ndarray],
        point_data: Mapping,
        cell_data: Mapping,
        dim: int,
    ) -> None:
        """Write one file, then the collection with it."""
        import meshio

        mesh = meshio.Mesh(
            np.pad(x, ((0, 0), (0, 3 - x.shape[1]))),
            [cells],
            point_data={name: _vtk(value, dim) for name, value in point_data.items()},
            cell_data={name: [_vtk(value, dim)] for name, value in cell_data.items()},
        )
        file = self.path.with_name(f"{self.path.name}_{run.steps:06d}.vtu")
        with complete(file) as part:
            meshio.write(part, mesh, file_format="vtu")
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
    """Rows as VTK takes them: three components of a vector, six of a symmetric tensor, no bools."""
    value = value.astype(np.int8) if value.dtype.kind == "b" else value
    if value.ndim == 2:
        width = value.shape[1]
        wide = {dim: 3, tensors.components(dim): 6}.get(width, width)
        value = np.pad(value, ((0, 0), (0, wide - width)))
    return np.ascontiguousarray(
        value.reshape(len(value), int(np.prod(value.shape[1:]))) if value.ndim > 2 else value
    )


# -- from all ranks to the first; every rank calls these -------------------------------------------


def _whole_grid(grid) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Nodes (n, dim) in global order and cells (cells, 2^dim) in VTK's order, on the first rank."""
    dim, V = grid.dim, grid.space
    x = V.tabulate_dof_coordinates()[:, :dim]
    cells = dolfinx_versions.cell_dofs(V)[: grid.owned_cells]
    axes = x[cells[:, [1, 2, 4][:dim]]] - x[cells[:, :1]]
    cells = np.where((np.linalg.det(axes) < 0.0)[:, None], cells[:, _MIRROR[dim]], cells)[
        :, _RING[dim]
    ]
    number = V.dofmap.index_map.local_to_global(np.arange(grid.nodes, dtype=np.int32))
    return _joined(grid.comm.gather(x[: V.dofmap.index_map.size_local])), _joined(
        grid.comm.gather(number[cells])
    )


def _whole_fields(run) -> list[dict[str, np.ndarray]]:
    """Fields on all nodes and on all cells, on the first rank."""
    owned = run.grid.space.dofmap.index_map.size_local, run.grid.owned_cells
    gathered = (
        run.grid.comm.gather({name: value[:n] for name, value in fields.items()})
        for n, fields in zip(owned, run.grid_fields(), strict=True)
    )
    return [_together(ranks) for ranks in gathered]


def _whole_cloud(bodies, comm: MPI.Comm) -> tuple[np.ndarray, dict[str, np.ndarray]] | None:
    """Positions (n, dim) and fields of all bodies' points, one body after the other, on the first
    rank."""
    ranks = comm.gather([{"x": body.x, **_carried(body, k)} for k, body in enumerate(bodies)])
    if ranks is None:
        return None
    whole_bodies = [_together(parts) for parts in zip(*ranks, strict=True)]
    names = dict.fromkeys(name for fields in whole_bodies for name in fields)
    cloud = {}
    for name in names:
        like = next(fields[name] for fields in whole_bodies if name in fields)
        cloud[name] = np.concatenate(
            [
                fields[name]
                if name in fields
                else np.full((len(fields["x"]), *like.shape[1:]), np.nan)
                for fields in whole_bodies
            ]
        )
    return cloud.pop("x"), cloud


def _carried(body, number: int) -> dict[str, np.ndarray]:
    """Local fields of a body: arrays it carries, its history by the material's names, and what
    follows."""
    n, found, names = len(body), dict(vars(body)), getattr(body.material, "history", ())
    if names and "history" in found:
        found.update(zip(names, found.pop("history").T, strict=True))
    fields = {
        name: value
        for name, value in found.items()
        if isinstance(value, np.ndarray)
        and value.shape[:1] == (n,)
        and 0 not in value.shape[1:]
        and value.dtype.kind in "fiub"
        and name not in _LEFT_OUT
        and not name.startswith("_")
    }
    return {
        **fields,
        "mean_stress": tensors.mean(body.stress),
        "von_mises": tensors.von_mises(body.stress),
        "density": body.mass / body.volume,
        "body": np.full(n, number, dtype=np.int32),
    }


def _together(ranks: list[dict[str, np.ndarray]] | None) -> dict[str, np.ndarray]:
    """What all ranks have by the same name, joined; nothing elsewhere than on the first rank."""
    if ranks is None:
        return {}
    return {
        name: _joined([fields[name] for fields in ranks])
        for name in ranks[0]
        if all(name in fields for fields in ranks)
    }


def _joined(parts: list[np.ndarray] | None) -> np.ndarray | None:
    return None if parts is None else np.concatenate(parts)
