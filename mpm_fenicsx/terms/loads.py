"""Boundaries and loads: each contributes its own virtual work, the simulation sums them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial, wraps

import numpy as np
from dolfinx import fem

from ..grid import weak_forms
from ..grid.grid import GridSurface
from ..points.surface_points import SurfacePoints
from .contribution import Contribution
from .scene import Scene

Surface = GridSurface | SurfacePoints


@dataclass(frozen=True)
class Traction:
    """Traction (Pa) on a surface: ``value`` is (dim,) numbers, or a function of t, or of t and x
    (n, dim).

    A load that stays as it is may be given point by point: an array (n, dim) for surface points,
    which moves with them, or a vector field on the mesh for facets.
    """

    on: Surface
    value: Callable | tuple[float, ...] | np.ndarray | fem.Function

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work -∫ t·w, and the work done."""
        patch, motion = scene.patch(self.on), scene.motion
        load = self._load(scene, patch)
        work = -weak_forms.load(load(), motion.w) * patch.measure

        def energy() -> dict[str, object]:
            return {"work": weak_forms.load(load(mean=True), motion.u) * patch.measure}

        return Contribution(work, force=work, energy=energy)

    def _load(self, scene: Scene, patch) -> Callable:
        name = "value of Traction"
        scene.check_alike(name, _kind(self.value))
        held = patch.held(self.value)
        if held is None:
            return partial(patch.load, *scene.load(name, self.value))
        return lambda mean=False: held if mean else scene.motion.known(held)


def _kind(value) -> str:
    """What a load is, as far as ranks have to do the same with it."""
    if isinstance(value, fem.Function):
        return "a field on the mesh"
    rows = isinstance(value, np.ndarray) and value.ndim == 2
    return "an array of rows" if rows else "numbers or a function"


@dataclass(frozen=True)
class Pressure:
    """Pressure (Pa) on a surface, against its outward normal: positive where it presses.

    ``value`` is a number, or a function of t, or of t and x (n, dim), to one number or (n,).  It is
    per area as it is and follows a surface of points that turns, by a step at a time: in a step
    normal and area are those of its start.  Facets of the grid do not turn.
    """

    on: Surface
    value: Callable | float

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work ∫ p n·w, and the work done."""
        patch, motion = scene.patch(self.on), scene.motion
        load = partial(patch.pressure, *scene.load("value of Pressure", _one_each(self.value), 1))
        work = -weak_forms.load(load(), motion.w) * patch.measure

        def energy() -> dict[str, object]:
            return {"work": weak_forms.load(load(mean=True), motion.u) * patch.measure}

        return Contribution(work, force=work, energy=energy)


@dataclass(frozen=True)
class DeadLoad(Traction):
    """A load whose force stays however its surface stretches: ``value`` (Pa) is per area at the
    start.

    ``value`` is (dim,) numbers, or a function of t, or of t and x (n, dim).  A traction is per area
    as it is: under one that keeps its direction the walls of a crater stretch, bear more, and
    stretch the faster.  On facets of the grid, which do not stretch, the two are one.  The start is
    when surface points meet their first DeadLoad in a run: later runs keep their ``rest_area``.
    """

    value: Callable | tuple[float, ...]

    def _load(self, scene: Scene, patch) -> Callable:
        function, placed = scene.load("value of DeadLoad", self.value)
        on = self.on
        if isinstance(on, GridSurface):
            return partial(patch.load, function, placed)
        on.remember_area()
        return partial(
            patch.load, lambda t, x: function(t, x) * (on.rest_area / on.area)[:, None], True
        )


def _one_each(value):
    """A number, or a function that gives one, or one a place, as rows of one number."""
    if not callable(value):
        return [value]

    @wraps(value)
    def rows(*arguments, **named):
        found = np.asarray(value(*arguments, **named))
        return found.reshape(1) if found.ndim == 0 else found[:, None]

    return rows
