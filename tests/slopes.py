"""Bodies with edges of any slope: tilted bars with waves in them, discs and balls."""

from __future__ import annotations

import numpy as np
from scipy.special import erf

import mpm_fenicsx as mpm

YOUNG, DENSITY = 20e6, 1500.0
LENGTH, WIDTH = 10.0, 2.0
PEAK = 1e-3  # m/s


class Bar:
    """A bar of 10 m × 2 m at ``degrees`` to the grid, in its middle a wave that runs to its end:
    v = V exp(−(s − L/2 − ct)²/2b²), s along the bar, with dashpots at both ends.

    ``wave``: P, or S with a motion across the bar.  With ``poisson`` > 0, or an S wave, tractions
    on its sides are those of a wave that runs on beyond them.
    """

    def __init__(self, degrees=30.0, wave="P", poisson=0.0, spread=0.7):
        self.soil = mpm.LinearElastic(YOUNG, poisson, DENSITY)
        self.speed = self.soil.p_speed if wave == "P" else self.soil.s_speed
        self.wave, self.spread, angle = wave, spread, np.radians(degrees)
        self.along = np.array([np.cos(angle), np.sin(angle)])
        self.across = np.array([-self.along[1], self.along[0]])
        self.way = self.along if wave == "P" else self.across
        self.corner = np.array([0.137, 0.211])
        low = self.corner + np.outer([0.0, LENGTH], self.along)
        self.corners = np.concatenate((low, low[::-1] + WIDTH * self.across))
        self.end = (LENGTH / 2 + 4 * spread) / self.speed

    def s(self, x):
        return (x - self.corner) @ self.along

    def inside(self, x):
        s, r = self.s(x.T), (x.T - self.corner) @ self.across
        return (s > 0) & (s < LENGTH) & (r > 0) & (r < WIDTH)

    def velocity(self, s, t):
        return PEAK * np.exp(-(((s - LENGTH / 2 - self.speed * t) / self.spread) ** 2) / 2)

    def acceleration(self, s, t):
        ahead = (s - LENGTH / 2 - self.speed * t) / self.spread
        return self.velocity(s, t) * ahead * self.speed / self.spread

    def displacement(self, s):
        """That at the start."""
        ahead = (s - LENGTH / 2) / self.spread / np.sqrt(2.0)
        return -PEAK / self.speed * self.spread * np.sqrt(np.pi / 2.0) * erf(ahead)

    def stress(self, s, t):
        """Tensors (n, 2, 2), Pa."""
        gradient = np.multiply.outer(
            -self.velocity(s, t) / self.speed, np.outer(self.way, self.along)
        )
        strain = 0.5 * (gradient + gradient.transpose(0, 2, 1))
        λ, μ = self.soil.lame
        return λ * np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(2) + 2 * μ * strain

    def sides(self, h):
        """The end that the wave comes to, the other one, and the two sides beside them."""
        return [
            mpm.SurfacePoints.line(self.corners[i], self.corners[(i + 1) % 4], 0.5 * h)
            for i in (1, 3, 0, 2)
        ]

    def material_points(self, h, mapping=mpm.DM_GC, courant=0.5, **filling):
        low = np.floor(self.corners.min(axis=0) / h - 2) * h
        high = np.ceil(self.corners.max(axis=0) / h + 2) * h
        grid = mpm.Grid.box(low, high, np.rint((high - low) / h).astype(int).tolist())
        body = mpm.MaterialPoints.fill(
            grid, self.soil, 4, inside=self.inside, **{"cut": True, **filling}
        )
        s = self.s(body.x)
        stress = self.stress(s, 0.0)
        body.stress[:, 0], body.stress[:, 1] = stress[:, 0, 0], stress[:, 1, 1]
        body.stress[:, 2] = self.soil.poisson * (stress[:, 0, 0] + stress[:, 1, 1])
        body.stress[:, 3] = stress[:, 0, 1]
        body.velocity = np.outer(self.velocity(s, 0.0), self.way)
        body.acceleration = np.outer(self.acceleration(s, 0.0), self.way)
        *ends, right, left = self.sides(h)
        terms = [mpm.ViscousBoundary(end, self.soil) for end in ends]
        if self.wave == "S" or self.soil.poisson:
            terms += [
                mpm.Traction(on, lambda t, x, n=sign * self.across: self.stress(self.s(x), t) @ n)
                for on, sign in ((right, -1.0), (left, 1.0))
            ]
        stepping = mpm.Newmark(courant * h / self.speed)
        return mpm.Simulation(grid, body, stepping, terms, mapping)

    def finite_elements(self, h, courant=0.5):
        """The bar's own mesh, which is not tilted."""
        grid = mpm.Grid.box((0, 0), (LENGTH, WIDTH), (round(LENGTH / h), round(WIDTH / h)))
        ends = mpm.ViscousBoundary(grid.facets("left", "right"), self.soil)
        run = mpm.FiniteElements(grid, self.soil, mpm.Newmark(courant * h / self.speed), [ends])
        s = grid.space.tabulate_dof_coordinates()[:, 0]
        run.nodal("displacement")[:, 0] = self.displacement(s)
        run.nodal("velocity")[:, 0] = self.velocity(s, 0.0)
        run.nodal("acceleration")[:, 0] = self.acceleration(s, 0.0)
        return run

    def errors(self, run):
        """L2 of the stress's error over time and place, and the part of the energy that is left
        when the wave has gone."""
        energy, turn = run.record(mpm.Energy()), np.eye(2)
        if run.bodies:
            body = run.bodies[0]
            s, weight = self.s(body.x), body.volume[:, None, None]
        else:
            s, weight = run.sampler("stress")[0][:, 0], 1.0
            turn = np.stack((self.along, self.across))
        wrong = known = 0.0
        for _ in range(int(self.end / run.stepping.dt)):
            run.step()
            row = run.bodies[0].stress if run.bodies else run.stress(np.arange(len(s)))
            found = mpm.tensors.matrix(row, 2)
            exact = turn @ self.stress(s, run.time) @ turn.T
            wrong += (weight * (found - exact) ** 2).sum()
            known += (weight * exact**2).sum()
        last = run.energy()
        return np.sqrt(wrong / known), (last["kinetic"] + last["strain"]) / energy.left[0]


class Ball:
    """A disc or a ball of 1 m somewhere on a grid of cells of ``h``, cut at its edge."""

    def __init__(self, dim, h, soil, radius=1.0, whole=True):
        self.radius, self.h = radius, h
        self.centre = np.array([0.03, 0.07, 0.05])[:dim] * h if whole else np.zeros(dim)
        n = int(radius / h) + 3
        low, cells = (-n * h, 2 * n) if whole else (0.0, n)
        self.grid = mpm.Grid.box((low,) * dim, (n * h,) * dim, (cells,) * dim)
        self.body = mpm.MaterialPoints.fill(
            self.grid, soil, 2**dim, inside=lambda x: self.level(x) < 0, cut=True
        )

    def level(self, x):
        return np.sqrt(((x.T - self.centre) ** 2).sum(axis=1)) - self.radius

    def edge(self, per_cell=None):
        return mpm.SurfacePoints.level_set(self.grid, self.level, per_cell)
