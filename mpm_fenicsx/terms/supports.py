"""Supports: nodes whose motion is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from ..common.checks import one_of
from ..common.ranks import together, warn
from ..dynamics.motion import KnownMotion
from ..dynamics.prescribed_motion import AccelerationRecord, Displacement, Prescribed, WholeMotion
from ..dynamics.record import Record
from ..grid.grid import GridSurface
from .contribution import Contribution
from .load_functions import of_time
from .scene import Scene


@dataclass(frozen=True)
class Fixed:
    """No displacement of ``components`` ("x", "xy", …; all by default) on facets of the grid, or a
    given motion.

    The motion, functions of t (s), is one of

    - ``value``, a displacement (m): velocity and acceleration are derived from it by differences
      over the step;
    - ``value`` with its ``velocity`` (m/s) and ``acceleration`` (m/s²): all three are taken as they
      are;
    - ``acceleration`` alone, a ``Record`` or another function: integrated by the trapezoidal rule,
      from rest at the start.

    Nodes of known motion have known velocity and acceleration, whatever the points around deposit
    there. The nodes of a material point run's grid move by the increment of the step and are then
    where they were, so that there it serves small settlements.  The work of what is moved is not
    among the recorder Energy's.
    Raises ``ValueError`` for surface points (they have no nodes of their own), a component that is
    not there, or another set of functions.
    """

    on: GridSurface
    components: str | None = None
    value: Callable[[float], float] | None = None
    velocity: Callable[[float], float] | None = None
    acceleration: Callable[[float], float] | None = None

    def bind(self, scene: Scene) -> Contribution:
        """Add Dirichlet conditions to the scene."""
        if not isinstance(self.on, GridSurface):
            raise ValueError(f"Fixed acts on facets of the grid, got {type(self.on).__name__}")
        grid = scene.grid
        with together(grid.comm, Exception):
            prescribed = self._prescribed(scene.motion.stepping.dynamic)
        scene.check_alike("motion of Fixed", getattr(prescribed, "description", "none"))
        if isinstance(self.acceleration, Record) and isinstance(prescribed, AccelerationRecord):
            doubt = self.acceleration.doubt_of_steps(scene.motion.stepping.dt)
            if doubt is not None:
                warn(grid.comm, f"Fixed: {doubt}", 3)
        if self.on.grid is not grid:
            raise ValueError(f"on: the facets {self.on.names} belong to another grid")
        axes = "xyz"[: grid.dim]
        if self.components is not None and not (
            isinstance(self.components, str | tuple | list) and self.components
        ):
            raise ValueError(
                f"components must be one or several of {axes} in a text, got {self.components!r}"
            )
        components = self.components or axes
        if self.components is None and isinstance(self.acceleration, Record):
            warn(
                grid.comm,
                f"components: Fixed moves {' and '.join(axes)} alike by one Record: name its "
                'direction, as in Fixed(base, "x", acceleration=record), and hold the others',
                3,
            )
        double = next((c for c in components if components.count(c) > 1), None)
        if double is not None:
            raise ValueError(
                f"components must name each direction once, got {double!r} twice in "
                f"{self.components!r}"
            )
        for c in components:
            V = grid.space.sub(axes.index(one_of("components", c, axes)))
            dofs = fem.locate_dofs_topological(V, grid.dim - 1, self.on.facets)
            scene.fixed.append(fem.dirichletbc(np.array(0.0), dofs, V))
            if prescribed is None:
                scene.motion.at_rest.append(dofs)
            else:
                scene.motion.moved.append(KnownMotion(dofs, prescribed))
        scene.supports.append(self)
        if prescribed is None:
            return Contribution()
        return Contribution(
            after=[prescribed.carry],
            memory=prescribed.state(),
            note=prescribed.description,
        )

    def _prescribed(self, dynamic: bool) -> Prescribed | None:
        """The motion given, or None for no motion."""
        names = [
            name
            for name in ("value", "velocity", "acceleration")
            if getattr(self, name) is not None
        ]
        for name in ("value", "velocity"):
            if isinstance(getattr(self, name), Record):
                raise ValueError(
                    f"{name} of Fixed must not be a Record, which is an acceleration: give "
                    "acceleration=record alone, or value=record.displacement_at"
                )
        functions = {name: of_time(f"{name} of Fixed", getattr(self, name)) for name in names}
        match names:
            case []:
                return None
            case ["value"]:
                return Displacement(functions["value"])
            case ["value", "velocity", "acceleration"]:
                return WholeMotion(*functions.values())
            case ["acceleration"] if dynamic:
                return AccelerationRecord(functions["acceleration"])
            case ["acceleration"]:
                raise ValueError(
                    "acceleration of Fixed is for dynamics: in a quasi-static run give value, a "
                    "displacement (m) of the load parameter"
                )
        raise ValueError(
            "Fixed takes value, or value with velocity and acceleration, or acceleration alone, "
            f"got {' and '.join(names)}"
        )
