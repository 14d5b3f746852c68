"""Whether supports hold a body at rest: the rigid motions that they leave free."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..grid import dolfinx_versions
from ..grid.grid import Grid

FREE = 1e-9
"""Of the largest singular value: below, a motion is free."""


def free_motion(grid: Grid, cells: np.ndarray, fixed: np.ndarray) -> str | None:
    """What nothing keeps the material in ``cells`` (cells,), bool, from, in words, or None; the
    same on all ranks.

    ``fixed`` (dofs,): those whose displacement is given.  Material is in one piece where its cells
    share nodes; each must be held on its own.  A fixed node without material holds nothing.
    """
    dim, numbers = grid.dim, grid.space.dofmap.index_map
    number = numbers.local_to_global(np.arange(grid.nodes, dtype=np.int32))
    corners = dolfinx_versions.cell_dofs(grid.space)[: grid.owned_cells][cells[: grid.owned_cells]]
    used = np.unique(corners)
    place = grid.space.tabulate_dof_coordinates()[used, :dim]
    mine = number[corners], number[used], place, fixed.reshape(-1, dim)[used]
    gathered, message = grid.comm.gather(mine), None
    if gathered is not None:
        corners, used, place, held = (np.concatenate(part) for part in zip(*gathered, strict=True))
        message = _first_free(corners, used, place, held)
    return grid.comm.bcast(message)


def _first_free(
    corners: np.ndarray, used: np.ndarray, place: np.ndarray, held: np.ndarray
) -> str | None:
    """The first piece that is not held; ``corners`` (cells, 2^dim) and ``used`` (n,) are numbers of
    nodes."""
    if not len(corners):
        return None
    node, at = np.unique(used, return_index=True)
    place, held, corners = place[at], held[at], np.searchsorted(node, corners)
    links = np.repeat(corners[:, :1], corners.shape[1], axis=1).ravel(), corners.ravel()
    pieces, piece = connected_components(
        coo_matrix((np.ones(len(links[0])), links), shape=(len(node),) * 2), False
    )
    for k in range(pieces):
        mine = piece == k
        motions = _free(place[mine], held[mine])
        if motions:
            x = place[mine].mean(axis=0)
            what = "the body" if pieces == 1 else f"the piece of material around x={np.round(x, 6)}"
            return f"nothing keeps {what} from {' and '.join(motions)}"
    return None


def _free(x: np.ndarray, held: np.ndarray) -> list[str]:
    """The rigid motions of nodes at x (n, dim) that the components in ``held`` (n, dim) allow, in
    words."""
    n, dim = x.shape
    size = max(np.ptp(x, axis=0).max(), np.finfo(float).tiny)
    away, axes = (x - x.mean(axis=0)) / size, "xyz"[:dim]
    turns = list(combinations(range(dim), 2))
    modes = np.zeros((n, dim, dim + len(turns)))  # displacements of each motion
    modes[:, range(dim), range(dim)] = 1.0
    for k, (i, j) in enumerate(turns):
        modes[:, i, dim + k], modes[:, j, dim + k] = -away[:, j], away[:, i]
    rows = modes[held]
    stiffness = rows.T @ rows
    value, mode = np.linalg.eigh(stiffness)
    free = mode[:, value <= FREE * max(value[-1], 1.0)]  # an orthonormal basis of what is free
    if not free.shape[1]:
        return []
    along = [d for d in range(dim) if np.linalg.norm(free[d]) > 1.0 - 1e-6]
    rest = free.shape[1] - len(along)
    found = [f"moving along {' and '.join(axes[d] for d in along)}"] if along else []
    about = [k for k in range(len(turns)) if np.abs(free[dim + k]).max(initial=0.0) > 1e-6]
    if rest and about:
        names = {2: [""], 3: [f" about {'xyz'[3 - i - j]}" for i, j in turns]}[dim]
        found.append("turning" + (names[about[0]] if len(about) == 1 else ""))
    elif rest:
        found.append("moving askew to the axes")
    return found
