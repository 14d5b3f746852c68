"""What a run shows, by name: fields of its points and of its grid, from all ranks on the first.

Every rank calls these functions; the first gets arrays, which may be the run's own, to be read and
not kept.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from ..common import tensors
from ..common.compiled import digits
from ..grid import dolfinx_versions
from ..grid.stress_field import StressField

_RING = {2: [0, 1, 3, 2], 3: [0, 1, 3, 2, 4, 5, 7, 6]}  # tensor order to VTK's
_MIRROR = {2: [0, 2, 1, 3], 3: [0, 2, 1, 3, 4, 6, 5, 7]}  # first two reference axes exchanged
_LEFT_OUT = {"x", "mass", "acceleration", "exposed"}


def whole_grid(grid) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Nodes (n, dim) in global order and cells (cells, 2^dim) in VTK's order, on the first rank."""
    dim, V = grid.dim, grid.space
    x = V.tabulate_dof_coordinates()[:, :dim]
    cells = dolfinx_versions.cell_dofs(V)[: grid.owned_cells]
    axes = x[cells[:, [1, 2, 4][:dim]]] - x[cells[:, :1]]
    cells = np.where((np.linalg.det(axes) < 0.0)[:, None], cells[:, _MIRROR[dim]], cells)[
        :, _RING[dim]
    ]
    number = V.dofmap.index_map.local_to_global(np.arange(grid.nodes, dtype=np.int32))
    return _joined(_gather(grid.comm, x[: V.dofmap.index_map.size_local])), _joined(
        _gather(grid.comm, number[cells])
    )


def whole_fields(run) -> list[dict[str, np.ndarray]]:
    """Fields on all nodes and on all cells, on the first rank."""
    owned = run.grid.space.dofmap.index_map.size_local, run.grid.owned_cells
    gathered = (
        _gather(run.grid.comm, {name: value[:n] for name, value in fields.items()})
        for n, fields in zip(owned, run.grid_fields(), strict=True)
    )
    return [_together(ranks) for ranks in gathered]


def whole_stress(field: StressField) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]] | None:
    """Corners (n, dim), cells (cells, 2^dim) in VTK's order, and the stress on the grid there, of
    cells that hold material, each with corners of its own, for the field jumps; on the first
    rank."""
    grid, lattice, dim = field.grid, field.grid.lattice, field.grid.dim
    filled = np.flatnonzero(field.filled[: grid.owned_cells])
    lower, upper = (bound[filled, None] for bound in (lattice.lower, lattice.upper))
    corners = np.where(digits(2, dim), upper, lower).reshape(-1, dim)
    rows = field.values[filled].reshape(len(corners), tensors.components(dim))
    ranks = _gather(grid.comm, {"x": corners, "stress": rows})
    if ranks is None:
        return None
    found = _together(ranks)
    x, stress = found["x"], found["stress"]
    cells = np.arange(len(x), dtype=np.int32).reshape(-1, 2**dim)[:, _RING[dim]]
    measures = {"mean_stress": tensors.mean(stress), "von_mises": tensors.von_mises(stress)}
    return x, np.ascontiguousarray(cells), {"stress": stress, **measures}


def whole_cloud(bodies, comm: MPI.Comm) -> tuple[np.ndarray, dict[str, np.ndarray]] | None:
    """Positions (n, dim) and fields of all bodies' points, one body after the other, on the first
    rank."""
    ranks = _gather(comm, [{"x": body.x, **_carried(body, k)} for k, body in enumerate(bodies)])
    if ranks is None:
        return None
    whole_bodies = [_together(parts) for parts in zip(*ranks, strict=True)]
    names = dict.fromkeys(name for fields in whole_bodies for name in fields)
    cloud = {}
    for name in names:
        like = next(fields[name] for fields in whole_bodies if name in fields)
        cloud[name] = _joined(
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
    if parts is None or len(parts) == 1:
        return parts and parts[0]
    return np.concatenate(parts)


def _gather(comm: MPI.Comm, mine) -> list | None:
    """What all ranks have, on the first; one rank alone has its own, and not a copy."""
    return [mine] if comm.size == 1 else comm.gather(mine)
