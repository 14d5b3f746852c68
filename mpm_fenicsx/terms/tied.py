"""Tied sides: two opposite sides of the grid that are one, so that the ground goes on over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..common.checks import one_of
from ..grid.cells import SIDES
from ..grid.grid import Grid, GridSurface
from ..mapping.tied_sides import TiedSides
from .contribution import Contribution
from .scene import Scene


@dataclass(frozen=True)
class Tied:
    """Two opposite sides of the grid are tied: nodes that lie opposite each other move together.

    ``one`` and ``other``: sides by name, such as "left" and "right", or ``grid.facets("left")``.
    What acts on either side acts on both, and a fixed node fixes those opposite it.  Material
    points that leave on one side come in on the other, with their velocity and stress; their
    displacement goes on.  A column whose sides are tied is a column of level ground, whatever
    shakes it, and a box tied at all sides but base and surface a piece of ground that repeats
    itself.
    ``components`` ("x", "xy", …; all by default): which are tied; material points take all.
    Raises ``ValueError`` for sides that are not opposite, are tied already, or whose nodes are.
    """

    one: GridSurface | str
    other: GridSurface | str
    components: str | None = None

    def __post_init__(self) -> None:
        sides = [_side(name, getattr(self, name)) for name in ("one", "other")]
        if SIDES[sides[0]][0] != SIDES[sides[1]][0] or sides[0] == sides[1]:
            raise ValueError(
                f"other must be the side opposite {sides[0]!r}, {_opposite(sides[0])!r}, got "
                f"{sides[1]!r}"
            )
        given = self.components
        if given is None:
            return
        if not given or not isinstance(given, str | tuple | list):
            raise ValueError(
                f"components must be one or several of xyz in a text, got {given!r}; leave it out "
                "to tie all"
            )
        for c in given:
            one_of("components", c, "xyz")

    @property
    def direction(self) -> int:
        """Across the two sides."""
        return SIDES[_side("one", self.one)][0]

    def components_in(self, grid: Grid) -> np.ndarray:
        """Which components (dim,), bool, are tied.  Raises ``ValueError`` for what that grid does
        not have."""
        side, axes = _side("one", self.one), "xyz"[: grid.dim]
        if self.direction >= grid.dim:
            raise ValueError(f"one: a grid in {grid.dim}D has no side {side!r}")
        for name in ("one", "other"):
            surface = getattr(self, name)
            if isinstance(surface, GridSurface) and surface.grid is not grid:
                raise ValueError(f"{name}: the facets {surface.names} belong to another grid")
        for c in self.components or axes:
            one_of("components", c, axes)
        return np.array([c in (self.components or axes) for c in axes])

    def bind(self, scene: Scene) -> Contribution:
        """The run ties the nodes; see ``tied_sides``."""
        return Contribution(note=str(scene.sides))


def tied_sides(grid: Grid, terms: Sequence) -> TiedSides | None:
    """The tied sides of a scene with these terms, or None.  Collective; raises ``ValueError``, on
    all ranks, for sides that cannot be tied."""
    found = [term for term in terms if isinstance(term, Tied)]
    if not found:
        return None
    directions = [term.direction for term in found]
    for term, d in zip(found, directions, strict=True):
        if directions.count(d) > 1:
            raise ValueError(f"terms: the sides of {term!r} are tied twice: leave out one of them")
    return TiedSides(grid, [(term.direction, term.components_in(grid)) for term in found])


def _side(name: str, side: GridSurface | str) -> str:
    """The name of a side of the grid."""
    if isinstance(side, GridSurface) and len(side.names) == 1 and side.names[0] in SIDES:
        return side.names[0]
    if isinstance(side, GridSurface):
        raise ValueError(
            f"{name} must be a whole side of the grid, one of {', '.join(SIDES)}, got the facets "
            f"{side.names}"
        )
    return one_of(name, side, SIDES)


def _opposite(side: str) -> str:
    d, end = SIDES[side]
    return next(name for name, at in SIDES.items() if at == (d, 1 - end))
