"""What a run shows, by name: fields of its points and of its grid, as far as a rank has them.

Every rank calls these functions.
"""

from __future__ import annotations

from typing import NamedTuple

from mpi4py import MPI

import numpy as np

from ..common import tensors
from ..common.compiled import digits
from ..grid import dolfinx_versions
from ..grid.stress_field import StressField

_RING = {2: [0, 1, 3, 2], 3: [0, 1, 3, 2, 4, 5, 7, 6]}  # tensor order to VTK's
_MIRROR = {2: [0, 2, 1, 3], 3: [0, 2, 1, 3, 4, 6, 5, 7]}  # first two reference axes exchanged
_LEFT_OUT = {"x", "mass", "acceleration", "exposed"}


class Piece(NamedTuple):
    """What one rank shows of points or of a grid.

    ``x`` (n, dim), m; ``cells`` (m, corners), rows of x in VTK's order; fields on both, (n, …) and
    (m, …), by name.  Arrays may be the run's own, to be read and not kept.
    """

    x: np.ndarray
    cells: np.ndarray
    point_data: dict[str, np.ndarray]
    cell_data: dict[str, np.ndarray]


class Frame(NamedTuple):
    """What a rank shows of the grid itself: ``nodes`` (n,) of its own cells, their places ``x`` (n,
    dim), m, and ``cells`` (m, 2^dim), rows of x in VTK's order."""

    nodes: np.ndarray
    x: np.ndarray
    cells: np.ndarray


def grid_frame(grid) -> Frame:
    """The cells that this rank owns, with their nodes; no ghosts."""
    dim, V = grid.dim, grid.space
    x = V.tabulate_dof_coordinates()[:, :dim]
    cells = dolfinx_versions.cell_dofs(V)[: grid.owned_cells]
    axes = x[cells[:, [1, 2, 4][:dim]]] - x[cells[:, :1]]
    cells = np.where((np.linalg.det(axes) < 0.0)[:, None], cells[:, _MIRROR[dim]], cells)[
        :, _RING[dim]
    ]
    nodes = np.unique(cells)
    return Frame(nodes, x[nodes], np.searchsorted(nodes, cells))


def grid_piece(run, frame: Frame) -> Piece:
    """Fields of the run on this rank's nodes and in its cells."""
    nodal, in_cells = run.grid_fields()
    nodal = {name: value[frame.nodes] for name, value in nodal.items()}
    in_cells = {name: value[: len(frame.cells)] for name, value in in_cells.items()}
    return Piece(frame.x, frame.cells, *_agreed(run.grid.comm, [nodal, in_cells]))


def stress_piece(field: StressField) -> Piece:
    """The stress on the grid in this rank's cells that hold material, each with corners of its own,
    for the field jumps."""
    grid, lattice, dim = field.grid, field.grid.lattice, field.grid.dim
    filled = np.flatnonzero(field.filled[: grid.owned_cells])
    lower, upper = (bound[filled, None] for bound in (lattice.lower, lattice.upper))
    x = np.where(digits(2, dim), upper, lower).reshape(-1, dim)
    stress = field.values[filled].reshape(len(x), tensors.components(dim))
    cells = np.arange(len(x), dtype=np.int32).reshape(-1, 2**dim)[:, _RING[dim]]
    measures = {"mean_stress": tensors.mean(stress), "von_mises": tensors.von_mises(stress)}
    return Piece(x, np.ascontiguousarray(cells), {"stress": stress, **measures}, {})


def points_piece(bodies, comm: MPI.Comm) -> Piece:
    """This rank's points of all bodies, one body after the other, with NaN in bodies that lack a
    field."""
    carried = _agreed(comm, [{"x": body.x, **_carried(body, k)} for k, body in enumerate(bodies)])
    cloud = {}
    for name in dict.fromkeys(name for fields in carried for name in fields):
        like = next(fields[name] for fields in carried if name in fields)
        cloud[name] = _joined(
            [
                fields[name]
                if name in fields
                else np.full((len(fields["x"]), *like.shape[1:]), np.nan)
                for fields in carried
            ]
        )
    x = cloud.pop("x")
    return Piece(x, np.arange(len(x), dtype=np.int32)[:, None], cloud, {})


def whole(piece: Piece, comm: MPI.Comm) -> Piece | None:
    """The pieces of all ranks as one, on the first rank; nodes between ranks are there twice."""
    ranks = [piece] if comm.size == 1 else comm.gather(piece)
    if ranks is None:
        return None
    first = np.cumsum([0, *(len(part.x) for part in ranks[:-1])])
    point_data, cell_data = (
        {name: _joined([fields[name] for fields in parts]) for name in parts[0]}
        for parts in zip(*((part.point_data, part.cell_data) for part in ranks), strict=True)
    )
    cells = [part.cells + start for part, start in zip(ranks, first, strict=True)]
    return Piece(_joined([part.x for part in ranks]), _joined(cells), point_data, cell_data)


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


def _agreed(comm: MPI.Comm, groups: list[dict]) -> list[dict]:
    """Of each group of fields those that all ranks have by the same name, with rows of the same
    shape, and of one type everywhere.  Collective."""
    if comm.size == 1:
        return groups
    ranks = comm.allgather(
        [{name: (a.dtype, a.shape[1:]) for name, a in fields.items()} for fields in groups]
    )
    return [
        {
            name: value.astype(np.result_type(*(kinds[name][0] for kinds in known)), copy=False)
            for name, value in fields.items()
            if all(name in kinds and kinds[name][1] == value.shape[1:] for kinds in known)
        }
        for fields, *known in zip(groups, *ranks, strict=True)
    ]


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
