"""Rayleigh damping: a part that goes with mass, and one that goes with stiffness."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from dolfinx import fem
from ufl import inner

from ..common.checks import array, between, finite, in_short
from ..grid import dolfinx_versions, weak_forms
from .contribution import Contribution
from .ghost_penalty import CellWeights
from .plain_cells import PlainCells
from .scene import Scene

Resisting = tuple[Callable, Callable]
"""Virtual works of mass and of elastic stiffness, functions of v and w."""


@dataclass(frozen=True)
class RayleighDamping:
    """Damping of soil by α times its mass and β times its elastic stiffness.

    A vibration of angular frequency ω is damped by the ratio α/(2ω) + βω/2 of the critical
    damping.  ``ratio`` ξ (-) is what it is to be at both of ``frequencies`` (f₁, f₂), Hz, with
    ω₁ = 2π f₁ and ω₂ = 2π f₂:

        α = 2 ξ ω₁ ω₂/(ω₁ + ω₂),    β = 2 ξ/(ω₁ + ω₂)

    Between them it is less than ξ, outside more (``ratio_at``).  Or give ``alpha`` (1/s) and
    ``beta`` (s), one of which may be left out, instead of both.
    ``material``: the soil of that law alone, so that each material may have a term of its own;
    None: all soil.  Cells of a ``FarField`` are damped too, those of an ``AbsorbingLayer`` not.

    The stiffness is the elastic one, before yield: a law that yields or softens is damped no less.
    With material points it is that of the points where they are; in finite elements that of the
    body at rest, so that with finite strain rotations must stay small there.  α resists every
    motion, that of a body as a whole too.
    The energy recorder gets "damped": what a step loses, exact for the trapezoidal rule.
    Raises ``ValueError`` naming what is out of range; in a run for statics, for a material of
    which there is no soil, and for soil that is damped by two terms.
    """

    ratio: float | None = None
    frequencies: tuple[float, float] | None = None
    alpha: float | None = None
    beta: float | None = None
    material: object | None = None

    def __post_init__(self) -> None:
        by_ratio = self.ratio is not None or self.frequencies is not None
        by_factors = self.alpha is not None or self.beta is not None
        if by_ratio == by_factors:
            raise ValueError(
                "RayleighDamping takes ratio and frequencies, or alpha and beta: got "
                + ("all of them" if by_ratio else "none of them")
            )
        α, β = self._fitted() if by_ratio else self._factors()
        object.__setattr__(self, "alpha", α)
        object.__setattr__(self, "beta", β)

    def _fitted(self) -> tuple[float, float]:
        if self.ratio is None or self.frequencies is None:
            missing = "ratio" if self.ratio is None else "frequencies"
            raise ValueError(f"RayleighDamping takes ratio and frequencies: {missing} is missing")
        ξ = between("ratio", self.ratio, 0.0, 1.0)
        f = array("frequencies", self.frequencies)
        if f.shape != (2,) or not np.isfinite(f).all() or not 0.0 < f[0] < f[1]:
            raise ValueError(
                "frequencies must be two numbers of Hz, the lower one first and positive, got "
                f"{self.frequencies}"
            )
        object.__setattr__(self, "ratio", ξ)
        object.__setattr__(self, "frequencies", tuple(f.tolist()))
        low, high = 2.0 * math.pi * f
        return float(2.0 * ξ * low * high / (low + high)), float(2.0 * ξ / (low + high))

    def _factors(self) -> tuple[float, float]:
        found = []
        for name in ("alpha", "beta"):
            value = getattr(self, name)
            number = 0.0 if value is None else finite(name, value)
            if number < 0.0:
                raise ValueError(f"{name} must not be negative, got {number}: that feeds motion")
            found.append(number)
        if not any(found):
            raise ValueError("alpha and beta are both zero, which damps nothing: leave it out")
        return found[0], found[1]

    def ratio_at(self, frequency: float | np.ndarray) -> float | np.ndarray:
        """Damping ratio α/(2ω) + βω/2 (-) at frequencies (Hz, > 0), one or an array.

        Raises ``ValueError`` for a frequency that is not positive.
        """
        f = array("frequency", frequency)
        if not (f > 0.0).all():
            raise ValueError(f"frequency must be positive, got {frequency}")
        ω = 2.0 * math.pi * f
        found = 0.5 * (self.alpha / ω + self.beta * ω)
        return float(found) if f.ndim == 0 else found

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work ∫ α ρ v·w + β σ(v):∇w, σ(v) the elastic stress of the rate of strain, and
        the energy lost."""
        motion = scene.motion
        if not motion.stepping.dynamic:
            raise ValueError(f"{type(self).__name__} needs velocities: step with Newmark")
        self._refuse_twice(scene)
        contribution, beside = Contribution(note=self._note()), self._far_fields(scene)
        soil = self._soil(scene, elsewhere=bool(beside))
        resisting = []
        if soil is not None:
            resisting.append(_of_body(scene, soil, contribution.before))
            contribution.work = self._work(scene, resisting[0], motion.velocity, motion.w)
        for part, fields in beside:
            resisting.append(_of_far_field(part, fields))
            work = self._work(scene, resisting[-1], part.velocity, motion.w)
            scene.beside.append(Contribution(work, history=[part.V, part.A]))

        def energy() -> dict[str, object]:
            lost = sum(self._work(scene, one, motion.u, motion.u) for one in resisting)
            return {"damped": 1.0 / motion.dt * lost}

        contribution.energy = energy
        return contribution

    def _work(self, scene: Scene, resisting: Resisting, v, w):
        """α and β times the virtual works of mass and stiffness; without a factor there is none."""
        return sum(
            fem.Constant(scene.grid.mesh, np.array(factor)) * virtual(v, w)
            for factor, virtual in zip((self.alpha, self.beta), resisting, strict=True)
            if factor
        )

    def _refuse_twice(self, scene: Scene) -> None:
        for other in scene.damped:
            if other is None or self.material is None:
                raise ValueError(
                    "RayleighDamping without material damps all soil, and there is another one: "
                    "give each its material"
                )
            if other == self.material:
                raise ValueError(
                    f"RayleighDamping: two terms damp the material {in_short(other)}: give one"
                )
        scene.damped.append(self.material)

    def _soil(self, scene: Scene, elsewhere: bool) -> tuple | None:
        """ρ, λ and μ of what is damped; None where that is in far fields alone."""
        if self.material is None:
            return (scene.density, *scene.lame)
        try:
            return tuple(scene.of_material(self.material))
        except ValueError as error:
            if elsewhere:
                return None
            raise ValueError(f"material of RayleighDamping: {error}") from error

    def _far_fields(self, scene: Scene) -> list[tuple[PlainCells, tuple]]:
        """Plain cells of a body with ρ, λ and μ of what is damped in them."""
        found = [(part, part.of_material(self.material)) for part in scene.plain if part.heavy]
        return [(part, fields) for part, fields in found if fields is not None]

    def _note(self) -> str:
        factors = f"alpha = {self.alpha:.4g} 1/s, beta = {self.beta:.4g} s"
        if self.ratio is None:
            return factors
        low, high = self.frequencies
        return f"{self.ratio:.4g} of critical at {low:.4g} and {high:.4g} Hz: {factors}"


def _of_body(scene: Scene, soil: tuple, before: list) -> Resisting:
    """That of the body, whose ρ, λ and μ ``soil`` are; what it refreshes goes to ``before``."""
    density, λ, μ = soil

    def mass(v, w):
        return inner(density * v, w) * scene.dx

    @cache
    def bulk():
        return _bulk(scene, λ, μ, before)

    def stiffness(v, w):
        if not scene.b_bar:
            return weak_forms.elastic_work(λ, μ, v, w, scene.stiffness_dx)
        centre = scene.motion.region.dx(metadata={"quadrature_degree": 1})
        distortion = weak_forms.distortion_work(μ, v, w) * scene.stiffness_dx
        return distortion + weak_forms.dilation_work(bulk(), 0.0, v, w) * centre

    return mass, stiffness


def _bulk(scene: Scene, λ, μ, before: list):
    """K = λ + 2μ/3 of each cell; what refreshes it goes to ``before``.

    What points give is a field that varies in a cell, and may be negative at the centre of one that
    they fill in part: its mean is not.
    """
    if not scene.partly_filled:
        return λ + 2.0 * μ / 3.0
    W = dolfinx_versions.space(scene.grid.mesh, "DQ", 0)
    bulk, dofs = fem.Function(W), dolfinx_versions.cell_dofs(W)[:, 0]
    weights = [CellWeights(scene.grid, f) for f in (λ, μ)]

    def refresh(start: float, end: float) -> None:
        of_λ, of_μ = (weight.mean() for weight in weights)
        bulk.x.array[dofs] = np.maximum(of_λ + 2.0 * of_μ / 3.0, 0.0)

    before.append(refresh)
    return bulk


def _of_far_field(part: PlainCells, fields: tuple) -> Resisting:
    """That of plain cells."""
    density, λ, μ = fields
    return (
        lambda v, w: inner(density * v, w) * part.dx,
        lambda v, w: weak_forms.elastic_work(λ, μ, v, w, part.dx, part.centre),
    )
