"""Supports that meet: nodes that two of them move in different ways."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from dolfinx import fem

from ..common.ranks import anywhere, together
from .contribution import Contribution
from .load_functions import of_time
from .scene import Scene
from .supports import Fixed

AHEAD = 20
"""Steps that are looked at when a scene is built; the others as they come."""
ALIKE = 1e-9
"""Of the displacements: supports that move nodes by no more than that apart move them alike."""


def refuse_disagreement(scene: Scene) -> None:
    """Raise ``ValueError``, on all ranks, where two ``Fixed`` move the same component of a node
    differently.

    Looks at the first steps now, and at the others when they come.
    """
    pairs = [
        (a, b)
        for a, b in combinations(scene.supports, 2)
        if (a.value, a.acceleration) != (b.value, b.acceleration)
    ]
    meeting = [
        (a, b, place) for a, b in pairs for place in [_meet(scene, a, b)] if place is not None
    ]
    if not meeting:
        return

    def look(start: float, end: float) -> None:
        with together(scene.grid.comm):
            fault = next(filter(None, (_difference(*both, start, end) for both in meeting)), None)
            if fault:
                raise ValueError(fault)

    dt = scene.motion.stepping.dt
    with together(scene.grid.comm):
        for step in range(AHEAD if scene.motion.stepping.dynamic else round(1.0 / dt)):
            try:
                look_at = (_difference(*both, step * dt, (step + 1) * dt) for both in meeting)
                fault = next(filter(None, look_at), None)
            except Exception:  # of a record that ends before: the run may, too
                break
            if fault:
                raise ValueError(fault)
    scene.contributions.append(Contribution(before=[look]))


def _difference(a: Fixed, b: Fixed, place: str, start: float, end: float) -> str | None:
    """What two supports move a node by in a step, in words, if it is not the same."""
    both = (
        f"Fixed on {', '.join(a.on.names)} and Fixed on {', '.join(b.on.names)} share the node "
        f"{place}, and"
    )
    cure = "leave it out of one of them, by facets of your own"
    recorded = [
        support for support in (a, b) if support.value is None and support.acceleration is not None
    ]
    if recorded and any(support.value is not None for support in (a, b)):
        return f"{both} one moves it by an acceleration, the other by a displacement: {cure}"
    if recorded:
        moves = [_function("acceleration", support)(end) for support in (a, b)]
        unit = "m/s²"
    else:
        moves = [
            value(end) - value(start)
            for value in (_function("value", support) for support in (a, b))
        ]
        unit = "m"
    if abs(moves[0] - moves[1]) <= ALIKE * max(map(abs, moves)):
        return None
    return (
        f"{both} move it by {moves[0]:.6g} {unit} and {moves[1]:.6g} {unit} from t = {start:.6g} "
        f"to {end:.6g}: {cure}"
    )


def _function(name: str, support: Fixed) -> Callable[[float], float]:
    function = getattr(support, name)
    return (lambda t: 0.0) if function is None else of_time(f"{name} of Fixed", function)


def _meet(scene: Scene, a: Fixed, b: Fixed) -> str | None:
    """A node that both hold, and in which direction, the same words on all ranks; None where there
    is none."""
    grid, words = scene.grid, None
    axes = "xyz"[: grid.dim]
    x = grid.space.tabulate_dof_coordinates()[:, : grid.dim]
    for c in axes:
        if c in (a.components or axes) and c in (b.components or axes):
            V = grid.space.sub(axes.index(c))
            held = [fem.locate_dofs_topological(V, grid.dim - 1, s.on.facets) for s in (a, b)]
            if scene.sides is not None:
                held = [scene.sides.with_copies(dofs) for dofs in held]
            shared = np.intersect1d(*held)
            if len(shared) and words is None:
                words = f"x={x[shared[0] // grid.dim].round(9) + 0.0} in {c}"
    return anywhere(grid.comm, words)
