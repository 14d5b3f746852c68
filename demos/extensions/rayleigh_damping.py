"""Damping of your own
===================

Rayleigh's, C = α M + β K, for all soil or for one material.

The scene has what mass and stiffness are integrated with, and gives the fields of one material
alone.  The velocity is an expression of the motion, so that it is the one of the balance of forces
in every rule of time.

Run it by::

    python demos/extensions/rayleigh_damping.py
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from ufl import Identity, div, grad, inner, sym

import mpm_fenicsx as mpm


@dataclass(frozen=True)
class RayleighDamping:
    """Forces -(α M + β K) v: a mode of angular frequency ω has the damping ratio α/2ω + βω/2.

    ``alpha`` α (1/s), ``beta`` β (s); ``material``: that soil alone, all by default.
    """

    alpha: float
    beta: float
    material: object = None

    def bind(self, scene) -> mpm.Contribution:
        """Virtual work of the damping forces, and the energy they take."""
        if not scene.motion.stepping.dynamic:
            raise ValueError("RayleighDamping needs velocities: step with Newmark")
        motion, alone = scene.motion, self.material is not None
        density, *lame = scene.of_material(self.material) if alone else (scene.density, *scene.lame)

        def work(v, w):
            by_mass = self.alpha * inner(density * v, w) * scene.dx
            return by_mass + self.beta * elastic_work(scene, *lame, v, w)

        def energy() -> dict[str, object]:
            return {"damped": work(motion.u / motion.dt, motion.u)}

        return mpm.Contribution(work(motion.velocity, motion.w), energy=energy)


def elastic_work(scene, λ, μ, v, w):
    """Virtual work of the elastic stress of v against w: of change of shape, and of change of
    volume, which with ``b_bar`` is that of the middle of each cell."""
    dx, strain, unit = scene.stiffness_dx, sym(grad(v)), Identity(len(v))
    middle = dx(metadata={"quadrature_degree": 1}) if scene.b_bar else dx
    shape = inner(2 * μ * (strain - div(v) / 3 * unit), sym(grad(w))) * dx
    return shape + (λ + 2 * μ / 3) * div(v) * div(w) * middle


def energy_left(
    mapping=mpm.DM_GC, ratio: float = 0.02, cells: int = 40, periods: int = 2
) -> tuple[float, float]:
    """Energy of a standing compression wave after some periods over that at the start, and the
    exact one, exp(-2 ζ ω t) with ζ = ``ratio``, half of it by mass and half by stiffness.

    ``mapping``: of material points, or None for finite elements; ``cells`` a wavelength.
    """
    soil, length = mpm.LinearElastic(young=1e7, poisson=0.25, density=1800.0), 1.0
    ω, h = np.pi * soil.p_speed / length, 2.0 * length / cells
    damping = RayleighDamping(alpha=ratio * ω, beta=ratio / ω)
    grid = mpm.Grid.box((0.0, 0.0), (length, 2 * h), (cells // 2, 2))
    walls = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom", "top"), "y"),
    ]
    t = periods * 2.0 * np.pi / (ω * np.sqrt(1.0 - ratio**2))
    steps = round(t / (0.5 * h / soil.p_speed))
    if mapping is None:
        run = mpm.FiniteElements(grid, soil, mpm.Newmark(t / steps), [*walls, damping])
        x = grid.space.tabulate_dof_coordinates()[:, 0]
        run.nodal("velocity")[:, 0] = np.sin(np.pi * x / length)
    else:
        body = mpm.MaterialPoints.fill(grid, soil, 4)
        body.velocity = np.zeros_like(body.x)
        body.velocity[:, 0] = np.sin(np.pi * body.x[:, 0] / length)
        run = mpm.Simulation(grid, body, mpm.Newmark(t / steps), [*walls, damping], mapping)
    energy = run.record(mpm.Energy())
    run.until(t)
    return energy.left[-1] / energy.left[0], float(np.exp(-2.0 * ratio * ω * t))


if __name__ == "__main__":
    for mapping in (None, mpm.DM_GC):
        computed, exact = energy_left(mapping)
        print(f"{mapping or 'FE'}: energy left {computed:.5f}, exact {exact:.5f}")
