"""A body enters a grid: where its points lie, and whether its arrays fit."""

from __future__ import annotations

import numpy as np

from ..common import tensors
from ..common.ranks import together
from ..grid.grid import Grid
from .material_points import MaterialPoints


def enter(body: MaterialPoints, grid: Grid) -> np.ndarray:
    """Cell (n,) of each point.  Raises ``ValueError``, on all ranks, for a body that the grid does
    not hold."""
    if body.dim != grid.dim:
        raise ValueError(f"points have {body.dim} coordinates, the grid {grid.dim}")
    if not grid.comm.allreduce(len(body)):
        raise ValueError("points: a body has no material points")
    cell, message = grid.find(body.x), None
    outside = np.flatnonzero(cell < 0)
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
    with together(grid.comm):
        if message:
            raise ValueError(message)
        if not body.material.linear:  # what the law refuses it refuses here, on all ranks
            at_rest = np.zeros_like(body.stress)
            body.material.respond(at_rest, body.stress, body.remembered, body.parameters)
    return cell
