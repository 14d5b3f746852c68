"""A body enters a grid: where its points lie, and whether its arrays fit."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from ..common import tensors
from ..common.ranks import together
from ..grid.grid import Grid
from .material_points import MaterialPoints
from .migration import Migration


def enter(body: MaterialPoints, grid: Grid, migration: Migration | None = None) -> np.ndarray:
    """Cell (n,) of each point.  On several ranks ``migration`` takes them to their owners, and they
    get numbers; those made by hand that several ranks have count once.

    Raises ``ValueError``, on all ranks, for a body that the grid does not hold.
    """
    if body.dim != grid.dim:
        raise ValueError(f"points have {body.dim} coordinates, the grid {grid.dim}")
    if not grid.comm.allreduce(len(body)):
        raise ValueError("points: a body has no material points")
    cell, message = grid.find(body.x), None
    outside = np.flatnonzero(cell < 0)
    if migration is not None:
        going = migration.destinations([(body.x, cell)])
        outside = np.flatnonzero(going.cells[0] < 0)
    if len(outside):
        message = (
            f"points: {len(outside)} lie outside the grid, the first at x={body.x[outside[0]]}"
        )
    for name, numbers in (
        ("stress", tensors.components(body.dim)),
        ("velocity", body.dim),
        ("acceleration", body.dim),
    ):
        value = getattr(body, name)
        if value is not None and (
            np.shape(value) != (len(body), numbers) or not np.isfinite(value).all()
        ):
            message = (
                f"{name} of points must be {len(body)} rows of {numbers} finite numbers, got "
                f"{value!r}"
            )
    message = message or _fault_of_parameters(body)
    with together(grid.comm):
        if message:
            raise ValueError(message)
        if not body.material.linear:  # what the law refuses it refuses here, on all ranks
            at_rest = np.zeros_like(body.stress)
            body.material.respond(at_rest, body.stress, body.remembered, body.parameters)
    if migration is None:
        return cell
    body.take({name: value.copy() for name, value in body.state().items()})  # written into
    if going.moving[0]:
        by_hand = body.number is None and body.exposed is None
        origin = np.full(len(body), grid.comm.rank)
        arrays, rows, cells = migration.send(
            {"cell": cell, "origin": origin, **body.state()}, going.cells[0], going.far
        )
        cell, origin = arrays.pop("cell"), arrays.pop("origin")
        cell[rows] = cells
        body.take(arrays)
        if by_hand:
            once = _once(body, origin)
            cell = cell[once]
            body.take({name: value[once] for name, value in body.state().items()})
    if body.number is None:
        body.number = numbers_of(grid, body.x, cell)
    return cell


def _fault_of_parameters(body: MaterialPoints) -> str | None:
    """What is wrong with parameters that were given point by point, if anything is."""
    known = (*body.material.parameters, "size")
    for name, value in (body.parameters or {}).items():
        if name not in known:
            takes = ", ".join(body.material.parameters) or "none"
            return (
                f"parameters: {type(body.material).__name__} takes {takes} point by point, and not "
                f"{name!r}"
            )
        bad = ~np.isfinite(np.asarray(value, float))
        if bad.any():
            return f"parameters: {name} is not a number at x={body.x[int(np.argmax(bad))]}"
    return None


def _once(body: MaterialPoints, origin: np.ndarray) -> np.ndarray:
    """Which points (n,), bool, are left if each counts only as often as the first of the ranks
    ``origin`` (n,) gave it that has it."""
    things = np.column_stack((body.x, body.half, body.volume))
    _, which = np.unique(things, axis=0, return_inverse=True)
    which = which.ravel()
    first = np.full(len(which), np.iinfo(origin.dtype).max)
    np.minimum.at(first, which, origin)
    return origin == first[which]


def numbers_of(grid: Grid, x: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """A number (n,) for each point x (n, dim), m, in its rank's own cells (n,): by its cell's place
    in the grid and its own among the points of that cell, the same on any number of ranks.
    Collective."""
    order = np.lexsort((*x.T, cell))
    first = np.searchsorted(cell[order], cell[order])
    of_cell = np.empty(len(x), np.int64)
    of_cell[order] = np.arange(len(x)) - first
    most = 1 + grid.comm.allreduce(int(of_cell.max(initial=0)), op=MPI.MAX)
    return most * grid.cell_numbers[cell] + of_cell
