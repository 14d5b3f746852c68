"""What material points give to the grid's integrals: density and Lamé's constants, and body forces
that vary."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import ufl

from ..dynamics.motion import Motion
from ..points.material_points import MaterialPoints
from .lagged_properties import Kept
from .methods import Mapping
from .projection import Integration, Projection
from .shape_functions import Stencil
from .ties import Fills


class Properties:
    """Density ρ and Lamé's λ, μ of all bodies as discontinuous ``fields``.

    ``mass_dx`` and ``stiffness_dx`` are the measures whose integrals of them are exact.  Mass and
    stiffness share a projection where the mapping integrates them alike.  With ``reuse`` the fields
    of a cell stay as they are while they would change by less than that part (``Kept``).
    """

    def __init__(
        self,
        motion: Motion,
        mapping: Mapping,
        bodies: Sequence[MaterialPoints],
        stencils: Sequence[Stencil],
        reuse: float = 0.0,
    ):
        self.grid, self._bodies, self._stencils = motion.grid, bodies, stencils
        self._motion, self._mapping = motion, mapping
        self._mass, self._volume = mapping.mass, None
        self._parts: list[Properties] = []
        self._alike = mapping.mass is mapping.integrate
        ways = [(mapping.mass, 3)] if self._alike else [(mapping.mass, 1), (mapping.integrate, 2)]
        self.projections = [Projection(self.grid, way, fields) for way, fields in ways]
        self._kept = [Kept(projection, reuse) for projection in self.projections] if reuse else []
        self.fields = [f for way in self._kept or self.projections for f in way.fields]
        self.mass_dx, self.stiffness_dx = (
            _measure(motion, way) for way in (mapping.mass, mapping.integrate)
        )

    def project(self) -> None:
        """Refresh the fields for the points where they are now."""
        for projection in self.projections:
            projection.clear()
        for body, stencil in zip(self._bodies, self._stencils, strict=True):
            for projection, values in zip(self.projections, self._given(body), strict=True):
                projection.add(stencil, values)
        for projection in self.projections:
            projection.finish()
        for kept in self._kept:
            kept.refresh()
        self.project_volume()
        for part in self._parts:
            part.project()

    def _given(self, body: MaterialPoints) -> list[np.ndarray]:
        """Mass and volume-weighted moduli of the points, one array a projection."""
        lame = body.material.kinematics.moduli(body)
        if self._alike:
            given = np.empty((len(body), 3))
            given[:, 0] = body.mass
            moduli = given[:, 1:]
        else:
            moduli = np.empty((len(body), 2))
        for column, value in zip(moduli.T, lame, strict=True):
            np.multiply(body.volume, value, out=column)
        return [given] if self._alike else [body.mass[:, None], moduli]

    def of(self, material) -> tuple:
        """ρ, λ and μ of the bodies of one material, as fields that are kept up to date.

        Raises ``ValueError`` where no body is of it.
        """
        rows = [n for n, body in enumerate(self._bodies) if body.material == material]
        if not rows:
            raise ValueError(f"no body is of the material {material!r}")
        if len(rows) == len(self._bodies):
            return tuple(self.fields)
        bodies, stencils = ([things[n] for n in rows] for things in (self._bodies, self._stencils))
        self._parts.append(Properties(self._motion, self._mapping, bodies, stencils))
        return tuple(self._parts[-1].fields)

    def fills(self) -> Fills:
        """How full cells are: of mass where all bodies are as dense, else of volume, which then
        gets a field."""
        densities = {body.material.density for body in self._bodies}
        if len(densities) == 1:
            return Fills(self.grid, self.fields[0], densities.pop())
        self._volume = Projection(self.grid, self._mass, 1)
        self.project_volume()
        return Fills(self.grid, self._volume.fields[0], 1.0)

    def project_volume(self) -> None:
        """Refresh the part of each cell that material fills, where ``fills`` asked for it."""
        if self._volume is None:
            return
        self._volume.clear()
        for body, stencil in zip(self._bodies, self._stencils, strict=True):
            self._volume.add(stencil, body.volume[:, None])
        self._volume.finish()

    def state(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        return {
            f"{k}/{name}": value
            for k, kept in enumerate(self._kept)
            for name, value in kept.state().items()
        }

    def body_force(self, function: Callable[[float, float, np.ndarray], np.ndarray]):
        """ρb (N/m³) of a body force per mass, ``function`` of start, end and places x (n, dim),
        taken at the points; and what refreshes it for a step."""
        projection = Projection(self.grid, self._mass, self.grid.dim)

        def refresh(start: float, end: float) -> None:
            projection.clear()
            for body, stencil in zip(self._bodies, self._stencils, strict=True):
                projection.add(stencil, body.mass[:, None] * function(start, end, body.x))
            projection.finish()

        return ufl.as_vector(projection.fields), refresh


def _measure(motion: Motion, integration: Integration) -> ufl.Measure:
    return motion.region.dx(metadata={"quadrature_degree": integration.quadrature})
