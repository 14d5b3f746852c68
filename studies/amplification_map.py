"""The linear map of one step of a material point run, made of real steps, and what grows under it.

At amplitudes that do not move points a step is linear in their stress, velocity and acceleration,
and all that it knows of them are the nodal values

    f_i = Σ_p V_p σ_p ∇S_ip at free dofs,    v_i, a_i = what the points deposit (sweeps included),

so that (f, v, a) before and after are one matrix T, whatever the mapping: what points hold beyond
it never acts. Each column is a real ``Simulation.step`` of points that hold its nodal values; their
places are put back.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mpm_fenicsx import Simulation
from mpm_fenicsx.scenes.block import bar, h, soil, step_of  # noqa: F401  step_of with its map

# eigenvalues so near 1 (rigid motion) and -1 (velocities on rollers) are neutral, up to round-off
NEUTRAL = 1e-6


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
            deposit.append(run.nodal("velocity").ravel() / self.units[1])
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
) -> np.ndarray:
    """Product of the maps of so many steps of a free bar that moves ``speed`` cells each, as a
    whole number of cells in all, so that it begins anew: stress, velocity and acceleration along
    it, of two rows of points that are alike.

    Stress zero before: then displacement has no part in it.  ``change``: what is done to the run
    before its steps.
    """
    room = round(speed * steps) + 4
    run = change(bar(mapping, stepping, cells, material=material, before=3, after=room))
    (body,) = run.bodies
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
