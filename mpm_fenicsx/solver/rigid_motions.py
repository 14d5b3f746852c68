"""Whether supports hold a body at rest: the rigid motions that they leave free."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..grid import dolfinx_versions
from ..grid.grid import Grid
from ..mapping.tied_sides import TiedSides

FREE = 1e-9
"""Of the largest singular value: below, a motion is free."""


def free_motion(
    grid: Grid, cells: np.ndarray, fixed: np.ndarray, sides: TiedSides | None = None
) -> str | None:
    """What nothing keeps the material in ``cells`` (cells,), bool, from, in words, or None; the
    same on all ranks.

    ``fixed`` (dofs,): those whose displacement is given.  Material is in one piece where its cells
    share nodes, or lies on both of two tied ``sides``; each must be held on its own.  A fixed node
    without material holds nothing.
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
        message = _first_free(corners, used, place, held, None if sides is None else sides.opposite)
    return grid.comm.bcast(message)


def _first_free(
    corners: np.ndarray,
    used: np.ndarray,
    place: np.ndarray,
    held: np.ndarray,
    opposite: tuple[np.ndarray, ...] | None,
) -> str | None:
    """The first piece that is not held; ``corners`` (cells, 2^dim) and ``used`` (n,) are numbers of
    nodes, and so are the first two of ``opposite`` (see ``TiedSides``)."""
    if not len(corners):
        return None
    node, at = np.unique(used, return_index=True)
    place, held, corners = place[at], held[at], np.searchsorted(node, corners)
    links = np.repeat(corners[:, :1], corners.shape[1], axis=1).ravel(), corners.ravel()
    pieces, piece = connected_components(
        coo_matrix((np.ones(len(links[0])), links), shape=(len(node),) * 2), False
    )
    if opposite is not None:
        return _first_free_of_tied(place, held, piece, _both_used(node, opposite))
    for k in range(pieces):
        mine = piece == k
        motions = _free(place[mine], held[mine])
        if motions:
            x = place[mine].mean(axis=0)
            what = "the body" if pieces == 1 else f"the piece of material around x={np.round(x, 6)}"
            return f"nothing keeps {what} from {' and '.join(motions)}"
    return None


def _both_used(
    node: np.ndarray, opposite: tuple[np.ndarray, ...]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows (k,) and (k,) of ``node`` (n,), sorted, that lie opposite each other, both among them,
    and the components (k, dim) that move together."""
    a, b, tied = opposite
    there = np.isin(a, node) & np.isin(b, node)
    return np.searchsorted(node, a[there]), np.searchsorted(node, b[there]), tied[there]


def _first_free_of_tied(
    place: np.ndarray, held: np.ndarray, piece: np.ndarray, opposite: tuple[np.ndarray, ...]
) -> str | None:
    """The first of the pieces (nodes,), joined where nodes lie ``opposite`` each other, that is not
    held."""
    a, b, tied = opposite
    pieces, dim = piece.max() + 1, place.shape[1]
    modes = np.zeros((*place.shape, pieces, dim * (dim + 1) // 2))
    for k in range(pieces):
        mine = piece == k
        modes[mine, :, k] = _modes(place[mine])
    rows = np.concatenate((modes[held], (modes[a] - modes[b])[tied]))
    free = _null_space(rows.reshape(len(rows), -1)).reshape(pieces, modes.shape[-1], -1)
    for k, of_piece in enumerate(free):
        basis, size, _ = np.linalg.svd(of_piece, full_matrices=False)
        motions = _words(basis[:, size > 1e-6], dim)
        if motions:
            x = place[piece == k].mean(axis=0)
            what = "the body" if pieces == 1 else f"the piece of material around x={np.round(x, 6)}"
            return f"nothing keeps {what} from {' and '.join(motions)}"
    return None


def _modes(x: np.ndarray) -> np.ndarray:
    """Displacements (n, dim, motions) of nodes at x (n, dim) in each rigid motion."""
    n, dim = x.shape
    size = max(np.ptp(x, axis=0).max(), np.finfo(float).tiny)
    away = (x - x.mean(axis=0)) / size
    turns = list(combinations(range(dim), 2))
    modes = np.zeros((n, dim, dim + len(turns)))
    modes[:, range(dim), range(dim)] = 1.0
    for k, (i, j) in enumerate(turns):
        modes[:, i, dim + k], modes[:, j, dim + k] = -away[:, j], away[:, i]
    return modes


def _null_space(rows: np.ndarray) -> np.ndarray:
    """An orthonormal basis (motions, n) of what rows (m, motions) leave free."""
    value, mode = np.linalg.eigh(rows.T @ rows)
    return mode[:, value <= FREE * max(value[-1], 1.0)]


def _free(x: np.ndarray, held: np.ndarray) -> list[str]:
    """The rigid motions of nodes at x (n, dim) that the components in ``held`` (n, dim) allow, in
    words."""
    return _words(_null_space(_modes(x)[held]), x.shape[1])


def _words(free: np.ndarray, dim: int) -> list[str]:
    """A basis (motions, n) of rigid motions in words."""
    axes, turns = "xyz"[:dim], list(combinations(range(dim), 2))
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
