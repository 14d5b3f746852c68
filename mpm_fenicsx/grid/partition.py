"""Which rank owns which cell: coordinate bisection, with every vertex neighbour as a ghost.

Each rank has a slice of the cells, whichever, and none has all.
"""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI

import numpy as np

from ..common import exchange
from . import dolfinx_versions, live_meshes

EXACT = 2**52
"""Whole numbers up to here are sums of floats without round-off, in any order."""
BINS = 64
"""Into which all cells of a part that may be at the cut are sorted at once."""


def distribute(
    comm: MPI.Comm,
    x: np.ndarray,
    cells: np.ndarray,
    same: Callable[[np.ndarray], np.ndarray] | None = None,
):
    """Mesh of quadrilaterals or hexahedra, cut by coordinate bisection into parts of as many cells,
    all vertex neighbours ghosted.

    Each rank gives a slice of the nodes' places x (nodes, dim), m, and one of ``cells``
    (cells, 2^dim), their vertices in tensor order; a node's number is its place in all slices, one
    rank's after the other's, and so is a cell's.  ``same``: from numbers of nodes to those of which
    they are copies, where the mesh goes on over its edge: ghosts lie beyond it, too.  Collective.
    """
    first = comm.exscan(len(cells)) or 0
    number = first + np.arange(len(cells))
    return _mesh(comm, x, cells, number, np.ones(len(cells)), same)


def distribute_anew(
    mesh,
    number: np.ndarray,
    weight: np.ndarray,
    same: Callable[[np.ndarray], np.ndarray] | None = None,
):
    """The same mesh on the same ranks, cut so that their cells weigh as much.

    ``number``, ``weight`` (owned cells,): numbers that tell cells apart, and weights >= 0.  It is
    made from the same input, so that the same weights give the same mesh, to the order of its
    cells, whatever it was cut like before; input numbers stay.  Collective.
    """
    comm, topology, geometry = mesh.comm, mesh.topology, mesh.geometry
    cell, node = dolfinx_versions.input_numbers(mesh)
    vertices = node[dolfinx_versions.cell_vertices(mesh)[: len(number)]]
    x = np.asarray(geometry.x[: geometry.index_map().size_local, : topology.dim])
    places = _as_given(comm, node[: len(x)], {"x": x})
    given = _as_given(
        comm, cell[: len(number)], {"vertices": vertices, "number": number, "weight": weight}
    )
    return _mesh(comm, places["x"], given["vertices"], given["number"], given["weight"], same)


def _as_given(
    comm: MPI.Comm, number: np.ndarray, arrays: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """This rank's slice of all rows in the order of their ``number`` (n,), whole; rows that nobody
    has are zeros."""
    count = 1 + comm.allreduce(int(number.max(initial=-1)), op=MPI.MAX)
    ends = [count * (rank + 1) // comm.size for rank in range(comm.size)]
    to = np.searchsorted(ends, number, side="right")
    came = exchange.delivered(comm, {"at": number, **arrays}, to)
    first, end = exchange.slice_of(comm, count)
    at, out = came.pop("at") - first, {}
    for name, rows in came.items():
        out[name] = np.zeros((end - first, *rows.shape[1:]), rows.dtype)
        out[name][at] = rows
    return out


def _mesh(
    comm: MPI.Comm,
    x: np.ndarray,
    cells: np.ndarray,
    number: np.ndarray,
    weight: np.ndarray,
    same: Callable[[np.ndarray], np.ndarray] | None,
):
    if comm.size == 1:
        alone = np.arange(len(cells) + 1), np.zeros(len(cells), dtype=np.int64)
    else:
        corner = exchange.look_up(comm, x, cells.ravel()).reshape(*cells.shape, x.shape[1])
        owner = owners(comm, corner.mean(axis=1), number, weight, comm.size)
        alone = destinations(comm, cells if same is None else same(cells), owner)
    return live_meshes.count(dolfinx_versions.create_mesh(comm, x, cells, lambda _: alone))


# -- owners ----------------------------------------------------------------------------------------


def owners(
    comm: MPI.Comm, centre: np.ndarray, number: np.ndarray, weight: np.ndarray, ranks: int
) -> np.ndarray:
    """Which of ``ranks`` ranks is to own each of this rank's cells (n,).

    Parts are cut again and again across their longest extent, as the ranks on either side are to
    share the weight: what is below a cut weighs no more than its share, and less by no more than
    one cell.  Cells with the same coordinate go by those of earlier cuts, the latest first, then by
    ``number`` (n,), whole and >= 0, which no two share.  ``centre`` (n, dim), m; ``weight`` (n,),
    >= 0.  It does not matter which rank has which cell.  Collective.
    """
    weight = _whole(comm, weight)
    keys = np.concatenate((_in_order(centre), number[:, None].astype(np.int64)), axis=1)
    part, dim = np.zeros(len(centre), dtype=np.int64), centre.shape[1]
    first, count = np.array([0]), np.array([ranks])
    cut_at = np.array([[-1] * dim + [0]])  # level of each key's last cut; numbers come before none
    for level in range(1, ranks):
        if (count == 1).all():
            break
        low, high = _bounds(comm, part, len(count), keys)
        extent = _coordinates(high[:, :dim]) - _coordinates(low[:, :dim])
        extent[(high < low).any(axis=1)] = 0.0
        cut_at[np.arange(len(count)), np.argmax(extent, axis=1)] = level
        half = count // 2
        total = _sum(comm, part, len(count), weight)
        equal = total == 0  # nothing there weighs anything: as many cells on either side
        weight = np.where(equal[part], 1.0, weight)
        total = _sum(comm, part, len(count), weight)
        share = total // count * half + total % count * half // count  # without a large product
        whole = count[part] == 1  # stays as it is, and is the lower half of itself
        undecided, columns = np.flatnonzero(~whole), np.argsort(-cut_at, axis=1)
        below = whole | _below(comm, part, share, keys, weight, undecided, columns)
        half = np.maximum(half, 1)
        part = 2 * part + ~below
        first = np.stack((first, first + half), axis=1).ravel()
        count = np.stack((half, count - half), axis=1).ravel()
        kept = np.flatnonzero(count)
        cut_at = np.repeat(cut_at, 2, axis=0)[kept]
        part = np.searchsorted(kept, part)
        first, count = first[kept], count[kept]
    return first[part]


def _below(
    comm: MPI.Comm,
    part: np.ndarray,
    share: np.ndarray,
    keys: np.ndarray,
    weight: np.ndarray,
    undecided: np.ndarray,
    columns: np.ndarray,
) -> np.ndarray:
    """Which cells (n,) are the first of their part that weigh no more than its ``share`` (parts,).

    ``keys`` (n, k), whole numbers; ``undecided``: the cells that are asked for; ``columns``: which
    keys order each part (parts, k), the first one first.  The bin that holds the cut is divided
    again and again, in all parts at once.
    """
    parts, out = len(share), np.zeros(len(part), dtype=bool)
    weighs = np.zeros(parts, dtype=np.int64)  # of what is below for certain
    for column in columns.T:
        at = part[undecided]
        key = keys[undecided, column[at]]
        low, high = (limit[:, 0] for limit in _bounds(comm, at, parts, key[:, None]))
        key, low, high = (number.view(np.uint64) for number in (key, low, high))
        extent = np.where(low.view(np.int64) <= high.view(np.int64), high - low, 0)  # modulo 2⁶⁴
        while (extent > 0).any():
            width = extent // BINS + 1
            bin_ = ((key - low[at]) // width[at]).astype(np.int64)
            table = _sum(comm, at * BINS + bin_, parts * BINS, weight[undecided])
            upto = weighs[:, None] + np.cumsum(table.reshape(parts, -1), axis=1)
            first = np.argmax(upto > share[:, None], axis=1)  # that goes past the share
            open_ = extent > 0
            out[undecided[open_[at] & (bin_ < first[at])]] = True
            before = np.append(weighs[:, None], upto, axis=1)[np.arange(parts), first]
            weighs = np.where(open_, before, weighs)
            stays = ~open_[at] | (bin_ == first[at])
            undecided, key, at = undecided[stays], key[stays], at[stays]
            start = np.where(open_, first.astype(np.uint64) * width, 0)
            low = low + start
            extent = np.where(open_, np.minimum(extent - start, width - 1), 0)
    return out


def _whole(comm: MPI.Comm, weight: np.ndarray) -> np.ndarray:
    """Weights (n,) as multiples of one so small that it does not matter, so that sums are exact:
    ones are equal ones."""
    count = comm.allreduce(len(weight))
    most = comm.allreduce(float(weight.max(initial=0.0)), op=MPI.MAX)
    return np.rint(weight / most * (EXACT // max(count, 1))) if most else np.zeros(len(weight))


def _sum(comm: MPI.Comm, part: np.ndarray, parts: int, weight: np.ndarray) -> np.ndarray:
    """Weight of each part (parts,), whole numbers.  Collective."""
    found = np.bincount(part, weight, minlength=parts).astype(float)  # of nothing it is of integers
    comm.Allreduce(MPI.IN_PLACE, found)
    return found.astype(np.int64)


def _bounds(
    comm: MPI.Comm, part: np.ndarray, parts: int, keys: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest key of each part (parts, k)."""
    order = np.argsort(part, kind="stable")
    here, start = np.unique(part[order], return_index=True)
    # of ~key, which falls as key rises, the least is the largest's
    limits = np.full((parts, 2 * keys.shape[1]), np.iinfo(np.int64).max)
    if len(here):
        limits[here] = np.minimum.reduceat(np.concatenate((keys, ~keys), axis=1)[order], start)
    comm.Allreduce(MPI.IN_PLACE, limits, op=MPI.MIN)
    low, high = np.split(limits, 2, axis=1)
    return np.ascontiguousarray(low), ~high


def _in_order(x: np.ndarray) -> np.ndarray:
    """Whole numbers in the order of x, the bits of which they are."""
    bits = np.ascontiguousarray(x + 0.0).view(np.int64)
    return bits ^ ((bits >> 63) & np.iinfo(np.int64).max)


def _coordinates(number: np.ndarray) -> np.ndarray:
    """What ``_in_order`` has made whole numbers of."""
    bits = number ^ ((number >> 63) & np.iinfo(np.int64).max)
    return np.ascontiguousarray(bits).view(float)


# -- ghosts ----------------------------------------------------------------------------------------


def destinations(
    comm: MPI.Comm, cells: np.ndarray, owner: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (n + 1,) and, for each of this rank's cells, its owner and then, in order, the other
    ranks that own a cell with one of its nodes.

    ``cells`` (n, 2^dim), numbers of nodes; ``owner`` (n,).  Each node has a home, a rank where all
    that own cells around it meet.  Collective.
    """
    ranks = 1 + comm.allreduce(int(owner.max(initial=0)), op=MPI.MAX)
    mine = _distinct(cells.ravel() * ranks + np.repeat(owner, cells.shape[1]))
    came, count = exchange.send(comm, mine[:, None], mine // ranks % comm.size)
    answers, to = _meet(came[:, 0], np.repeat(np.arange(comm.size), count), ranks)
    told, _ = exchange.send(comm, answers[:, None], to)
    node, rank = np.divmod(np.sort(told[:, 0]), ranks)
    between = np.unique(node)
    start = np.append(np.searchsorted(node, between), len(node))
    place = np.searchsorted(between, cells.ravel())
    shared = np.flatnonzero(np.append(between, -1)[place] == cells.ravel())
    many, at = _ranges(start, place[shared])
    cell = np.repeat(shared // cells.shape[1], many)
    cell, ghost = np.divmod(_distinct(cell * ranks + rank[at]), ranks)
    other = ghost != owner[cell]
    cell, ghost = cell[other], ghost[other]
    offsets = np.concatenate(([0], np.cumsum(1 + np.bincount(cell, minlength=len(cells)))))
    out = np.empty(offsets[-1], dtype=np.int64)
    first = np.zeros(len(out), dtype=bool)
    first[offsets[:-1]] = True
    out[first], out[~first] = owner, ghost
    return offsets, out


def _meet(pairs: np.ndarray, asker: np.ndarray, ranks: int) -> tuple[np.ndarray, np.ndarray]:
    """Answers to ranks: pairs of the nodes that have several owners, and whom to tell each.

    ``pairs`` (n,): node · ranks + owner, from ranks ``asker`` (n,).
    """
    known = _distinct(pairs)
    node, start, many = np.unique(known // ranks, return_index=True, return_counts=True)
    several = many > 1
    node, start = node[several], np.append(start, len(known))
    place = np.searchsorted(node, pairs // ranks)
    asked = np.append(node, -1)[place] == pairs // ranks
    size = 1 + asker.max(initial=0)
    place, to = np.divmod(_distinct(place[asked] * size + asker[asked]), size)
    many, at = _ranges(start, np.flatnonzero(several)[place])
    return known[at], np.repeat(to, many)


def _distinct(number: np.ndarray) -> np.ndarray:
    """Numbers in order, each once."""
    number = np.sort(number)
    return number[np.concatenate((np.ones(1, bool), np.diff(number) > 0))[: len(number)]]


def _ranges(start: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How long some ranges are, of those that start at ``start`` (n + 1,), and all that is in them,
    one after the other."""
    many = (start[1:] - start[:-1])[which]
    before = np.cumsum(many) - many
    return many, np.arange(many.sum()) + np.repeat(start[which] - before, many)
