"""The state of a run goes to other ranks: after a restart on more or fewer of them, or where the
grid is divided anew.

Values of nodes and cells are found by the numbers these have on any number of ranks; points go to
the rank of their cell, and lie there in the order of their own numbers.  All functions are
collective.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mpi4py import MPI

import numpy as np

from ..common.exchange import delivered, fetched
from ..common.ranks import anywhere
from ..common.spread import Part, Spread, below
from ..grid.grid import Grid

OWN = ("number", "cell", "repartition")
"""Arrays that points have on several ranks alone, or find again; and what a run knows that divides
its grid anew, which another need not."""


def part_of(grid: Grid, state: Mapping[str, np.ndarray]) -> Part:
    """This rank's part of a state, not copied."""
    nodes = grid.space.dofmap.index_map.size_local
    owned = np.array([grid.owned_cells, nodes])
    weight = np.zeros(0) if grid.weight is None else grid.weight
    return Part(grid.cell_numbers, grid.node_numbers, owned, weight, dict(state))


def weights(grid: Grid, parts: Sequence[Part]) -> np.ndarray | None:
    """Weights (owned cells,) that divide the grid as it was where the parts come from; None where
    it is so already."""
    comm, asked = grid.comm, grid.cell_numbers[: grid.owned_cells]
    if comm.allreduce(sum(len(part.weight) for part in parts)):
        numbers = [part.cells[: part.owned[0]] for part in parts]
        rows = np.concatenate((np.zeros(0), *(part.weight for part in parts)))
        numbers = np.concatenate((asked[:0], *numbers))
        found = fetched(comm, numbers, {"weight": rows}, asked)["weight"]
        other = grid.weight is None or not np.array_equal(grid.weight, found)
    else:
        found, other = np.ones(len(asked)), grid.weight is not None
    return found if comm.size > 1 and comm.allreduce(int(other)) else None


def misfit(grid: Grid, parts: Sequence[Part], spread: Mapping[str, Spread]) -> str | None:
    """Why parts of another run's state cannot become that of a run whose arrays lie as in
    ``spread``, or None; the same on all ranks."""
    alike = [n for n, lies in spread.items() if lies is Spread.ALIKE and not _is_own(n)]
    message, here = None, {name for name in spread if not _is_own(name)}
    for part in parts:
        other = sorted(here ^ {name for name in part.state if not _is_own(name)})
        if other:
            where = "here" if other[0] in here else "in the checkpoint"
            message = f"{other[0]} is {where} alone"
    message = anywhere(grid.comm, message)
    if message:
        return message
    first = grid.comm.bcast([parts[0].state[name] for name in alike] if parts else None)
    for name, value in zip(alike, first, strict=True):
        if any(not np.array_equal(part.state[name], value) for part in parts):
            message = (
                f"{name} is not the same on the ranks that wrote it, so that no other ranks can go "
                "on with it"
            )
    return anywhere(grid.comm, message)


def fields(
    grid: Grid, parts: Sequence[Part], state: Mapping[str, np.ndarray], spread: Mapping[str, Spread]
) -> dict[str, np.ndarray]:
    """Arrays of ``state`` that belong to nodes or cells, or are alike, from the parts that each
    rank holds of the state on other ranks."""
    comm, found = grid.comm, {}
    kinds = ((Spread.CELLS, 0, grid.cell_numbers), (Spread.NODES, 1, grid.node_numbers))
    for kind, which, asked in kinds:
        rows, numbers = {}, [part[which][: part.owned[which]] for part in parts]
        for name in (name for name, lies in spread.items() if lies is kind):
            width = comm.allreduce(state[name].size // max(len(asked), 1), op=MPI.MAX)
            given = [part.state[name].reshape(-1, width)[: part.owned[which]] for part in parts]
            rows[name] = np.concatenate((np.empty((0, width), state[name].dtype), *given))
        if rows:
            numbers = np.concatenate((asked[:0], *numbers))
            found.update(fetched(comm, numbers, rows, asked))
    first = parts[0].state if parts else {}
    alike = {n: first[n] for n, lies in spread.items() if lies is Spread.ALIKE and n in first}
    found.update(comm.bcast(alike))
    return {name: value.reshape(state[name].shape) for name, value in found.items()}


def rows_of_points(
    grid: Grid, parts: Sequence[Part], cloud: str, per_face: int = 1
) -> dict[str, np.ndarray]:
    """Arrays of the points ``cloud`` that lie in this rank's cells, from the parts that each rank
    holds; so many in a row are one face and stay together."""
    comm, given = grid.comm, [below(f"{cloud}/", part.state) for part in parts]
    kinds = [(name, a.dtype, a.shape[1:]) for name, a in given[0].items()] if parts else None
    rows = {
        name: np.concatenate((np.empty((0, *shape), dtype), *(of[name] for of in given)))
        for name, dtype, shape in comm.bcast(kinds)
    }
    cells = [part.cells[of["cell"]] for part, of in zip(parts, given, strict=True)]
    cells = np.concatenate((grid.cell_numbers[:0], *cells))
    rows.setdefault("number", np.arange(len(cells)))  # on one rank they have none
    here = grid.cell_numbers[: grid.owned_cells]
    place = {
        "rank": np.full(len(here), comm.rank),
        "cell": np.arange(len(here), dtype=np.int32),
    }
    place = fetched(comm, here, place, np.repeat(cells[::per_face], per_face))
    rows = delivered(comm, {**rows, "cell": place["cell"]}, place["rank"])
    order = np.argsort(rows["number"], kind="stable")
    return {name: value[order] for name, value in rows.items()}


def _is_own(name: str) -> bool:
    return name.split("/")[-1] in OWN
