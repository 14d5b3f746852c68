"""The linear map of one step of a material point run, made of real steps, and what grows under it.

At amplitudes that do not move points a step is linear in their stress, velocity and acceleration,
and all that it knows of them are the nodal values

    f_i = Σ_p V_p σ_p ∇S_ip at free dofs,    v_i, a_i = what the points deposit (sweeps included),

so that (f, v, a) before and after are one matrix T, whatever the mapping: what points hold beyond
it never acts. Each column is a real ``Simulation.step`` of points that hold its nodal values; their
places are put back.

Scenes take the body's ``material`` and any option of ``Simulation``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mpm_fenicsx import Fixed, Grid, LinearElastic, MaterialPoints, Newmark, Simulation, Viscous

FACTOR = {"ksp_type": "preonly", "pc_type": "lu"}
AS_THEY_ARE = {"solver": FACTOR, "hold_cut_cells": False}  # every node is on its own, as T has it
# eigenvalues so near 1 (rigid motion) and -1 (velocities on rollers) are neutral, up to round-off
NEUTRAL = 1e-6
soil, h = LinearElastic(young=20e6, poisson=0.25, density=1500.0), 0.25


def at_rest(body: MaterialPoints) -> MaterialPoints:
    """The body with velocity and acceleration of its own, zero, so that no run takes a start for
    it."""
    body.velocity, body.acceleration = np.zeros_like(body.x), np.zeros_like(body.x)
    return body


def bar(
    mapping, stepping, cells=12, fixed=False, viscous=False, offset=0.0, material=soil, **options
) -> Simulation:
    """A bar between rollers, its left end free, fixed or on dashpots, ``offset`` cells off the grid
    lines."""
    room = 0 if fixed else 2
    grid = Grid.box((-room * h, 0), ((cells + 2) * h, h), (cells + 2 + room, 1))
    body = at_rest(
        MaterialPoints.fill(grid, material, 4, inside=lambda x: (x[0] > 0) & (x[0] < cells * h))
    )
    body.x[:, 0] += offset * h
    terms = [Fixed(grid.facets("bottom", "top"), "y")]
    terms += [Fixed(grid.facets("left"), "x")] if fixed else []
    terms += [Viscous(body.surface("left"), material)] if viscous else []
    return Simulation(grid, body, stepping, terms, mapping, **(AS_THEY_ARE | options))


def block(
    mapping, stepping, cells=(4, 3), viscous=False, offset=0.0, material=soil, **options
) -> Simulation:
    """A block, free all round or on dashpots, ``offset`` cells off the grid lines both ways."""
    nx, ny = cells
    grid = Grid.box((-2 * h, -2 * h), ((nx + 3) * h, (ny + 3) * h), (nx + 5, ny + 5))
    body = at_rest(
        MaterialPoints.fill(
            grid,
            material,
            4,
            inside=lambda x: ((x > 0) & (x.T < np.array(cells) * h).T).all(axis=0),
        )
    )
    body.x += offset * h
    terms = [Viscous(body.surface("bottom"), material)] if viscous else []
    return Simulation(grid, body, stepping, terms, mapping, **(AS_THEY_ARE | options))


class StepMap:
    """T of a run of one elastic body without loads: ``matrix`` (n, n) in the coordinates of
    ``nodal``.

    Units: stress ρc², velocity c, acceleration c/Δt with the P wave's speed c; force ρc²h.
    """

    def __init__(self, run: Simulation):
        self.run, (self.body,) = run, run.bodies
        self.kept = [
            (owner, name, getattr(owner, name).copy())
            for owner, names in (
                (self.body, ("x", "half", "volume")),
                *((patch.points, ("x", "normal", "area")) for patch in run.scene.patches),
            )
            for name in names
        ]
        self.plane = [0, 1, 3]  # xx, yy, xy
        c, ρ = self.body.material.p_speed, self.body.material.density
        self.units = ρ * c**2, c, c / run.stepping.dt
        run.prepare(0.0, run.stepping.dt)
        free, force, deposit = ~run.equilibrium.fixed, [], []
        for column in np.eye(3 * len(self.body)):
            self.put(column, 0.0, 0.0)
            force.append(run._internal_force()[free] / (self.units[0] * h))
        for column in np.eye(2 * len(self.body)):
            self.put(0.0, column, 0.0)
            run.predict()
            deposit.append(run.motion.v.x.array / self.units[1])
        self.bases = [self._basis(np.array(rows).T) for rows in (force, deposit)]

    def _basis(self, observe: np.ndarray):
        """What points' values (m,) are seen as, coordinates (r,) in the range, and a right inverse
        of it."""
        U, s, V = np.linalg.svd(observe, full_matrices=False)
        rank = int((s > 1e-10 * s[0]).sum())
        return U[:, :rank].T @ observe, V[:rank].T / s[:rank]

    def put(self, stress, velocity, acceleration) -> None:
        """Give the points values: stress (3 n,), velocity and acceleration (2 n,),
        dimensionless."""
        body, (σ, c, g) = self.body, self.units
        body.stress[:] = 0.0
        body.stress[:, self.plane] = σ * np.reshape(stress, (-1, 3) if np.ndim(stress) else ())
        body.velocity[:] = c * np.reshape(velocity, (-1, 2) if np.ndim(velocity) else ())
        body.acceleration[:] = g * np.reshape(
            acceleration, (-1, 2) if np.ndim(acceleration) else ()
        )

    def nodal(self) -> np.ndarray:
        """What the grid sees of the points: coordinates of (f, v, a)."""
        body, (σ, c, g), ((G, _), (D, _)) = self.body, self.units, self.bases
        return np.concatenate(
            (
                G @ body.stress[:, self.plane].ravel() / σ,
                D @ body.velocity.ravel() / c,
                D @ body.acceleration.ravel() / g,
            )
        )

    def hold(self, z: np.ndarray) -> None:
        """Give the points values that the grid sees as z."""
        (_, force), (_, deposit) = self.bases
        i, j = force.shape[1], force.shape[1] + deposit.shape[1]
        self.put(force @ z[:i], deposit @ z[i:j], deposit @ z[j:])

    def step(self, z: np.ndarray, scale: float = 1e-7) -> np.ndarray:
        """A real step from z, points put back; ``scale`` only keeps them from turning inside
        out."""
        self.hold(scale * z)
        self.run.step()
        found = self.nodal() / scale
        for owner, name, value in self.kept:
            getattr(owner, name)[:] = value
        return found

    @property
    def matrix(self) -> np.ndarray:
        """T (n, n)."""
        n = self.bases[0][1].shape[1] + 2 * self.bases[1][1].shape[1]
        return np.stack([self.step(z) for z in np.eye(n)], axis=1)


def crossing(
    mapping,
    stepping,
    speed=0.3,
    steps=10,
    cells=8,
    material=soil,
    change: Callable = lambda run: run,
    **options,
) -> np.ndarray:
    """Product of the maps of so many steps of a free bar that moves ``speed`` cells each, as a
    whole number of cells in all, so that it begins anew: stress, velocity and acceleration along
    it, of two rows of points that are alike.

    Stress zero before: then displacement has no part in it.  ``change``: what is done to the run
    before its steps.
    """
    way = round(speed * steps)
    grid = Grid.box((-3 * h, 0), ((cells + way + 4) * h, h), (cells + way + 7, 1))
    body = at_rest(
        MaterialPoints.fill(grid, material, 4, inside=lambda x: (x[0] > 0) & (x[0] < cells * h))
    )
    terms = [Fixed(grid.facets("bottom", "top"), "y")]
    run = change(Simulation(grid, body, stepping, terms, mapping, **(AS_THEY_ARE | options)))
    start = {name: getattr(body, name).copy() for name in ("x", "half", "volume")}
    column = np.unique(body.x[:, 0].round(9), return_inverse=True)[1]
    first = np.unique(column, return_index=True)[1]
    c, tiny = material.p_speed, 1e-9
    units = {
        "stress": tiny * material.density * c**2,
        "velocity": tiny * c,
        "acceleration": tiny * c / stepping.dt,
    }
    product = np.eye(3 * len(first))
    for k in range(steps):
        images = []
        for z in product.T:
            for name, value in start.items():
                getattr(body, name)[:] = value
            body.x[:, 0] += k * speed * h
            for (name, unit), part in zip(units.items(), z.reshape(3, -1), strict=True):
                values = getattr(body, name)
                values[:] = 0.0
                values[:, 0] = unit * part[column]
            run.step()
            images.append(
                np.concatenate(
                    [getattr(body, name)[first, 0] / unit for name, unit in units.items()]
                )
            )
        product = np.stack(images, axis=1)
    return product


def growth(T: np.ndarray, courant: float, steps: int = 1) -> dict:
    """What grows: largest |λ| - 1 a step, ωh/c of that mode, and of all that grow the number,
    lowest and highest.

    Neutral eigenvalues are left out.  ω = arg λ/Δt, as the step has it: π c/h over the Courant
    number at most.
    """
    λ = np.linalg.eigvals(T)
    λ = λ[(np.abs(λ - 1.0) > NEUTRAL) & (np.abs(λ + 1.0) > NEUTRAL)]
    size = np.abs(λ) ** (1.0 / steps) - 1.0
    ω = np.abs(np.angle(λ)) / (steps * courant)
    most, grow = int(np.argmax(size)), size > 1e-9
    found = {
        "growth": float(size[most]),
        "frequency": float(ω[most]),
        "modes": int(grow.sum()) // 2,
    }
    return (
        found | {"lowest": float(ω[grow].min()), "highest": float(ω[grow].max())}
        if grow.any()
        else found
    )


def step_of(courant: float, material=soil) -> Newmark:
    """Newmark at a Courant number of the P wave."""
    return Newmark(courant * h / material.p_speed)
