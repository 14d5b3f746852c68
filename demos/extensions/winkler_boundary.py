"""A boundary of your own
======================

Winkler's bed of springs.

A term needs ``bind``, which returns its virtual work.  ``scene.patch(on)`` is the surface as forms
see it, facets of the grid or points that move with the body alike: it remembers what springs have
accumulated, also for restarts and for steps that are taken back.

Run it by::

    python demos/extensions/winkler_boundary.py
"""

from __future__ import annotations

from dataclasses import dataclass

from ufl import inner

import mpm_fenicsx as mpm


@dataclass(frozen=True)
class WinklerBoundary:
    """Springs beneath a surface: σ_n = -k_n u_n, σ_s = -k_s u_s, u since the start.

    ``on``: facets of the grid or surface points; ``normal`` k_n and ``shear`` k_s (Pa/m).
    """

    on: object
    normal: float
    shear: float = 0.0

    def bind(self, scene) -> mpm.Contribution:
        """Virtual work ∫ (k u)·w, and the energy stored."""
        patch, motion = scene.patch(self.on), scene.motion
        k, borne = patch.tensor(self.normal, self.shear), patch.stored(self.normal, self.shear)
        work = inner(k * motion.u + motion.known(borne), motion.w) * patch.measure

        def energy() -> dict[str, object]:
            return {"stored": inner(0.5 * k * motion.u + borne, motion.u) * patch.measure}

        return mpm.Contribution(work, energy=energy, holds=True)


def settled(load: float = 1e3, height: float = 2.0, stiffness: float = 5e5) -> tuple[float, float]:
    """Settlement (m) of the top of an elastic block on Winkler's bed, and the exact one, p/k + p
    h/E."""
    soil = mpm.LinearElastic(young=1e6, poisson=0.0, density=1800.0)
    grid = mpm.Grid.box((0.0, -0.5), (1.0, height), (4, 10))  # room to sink
    body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: x[1] > 0.0)
    run = mpm.Simulation(
        grid,
        body,
        mpm.QuasiStatic(1),
        [
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.Traction(body.surface("top"), (0.0, -load)),
            WinklerBoundary(body.surface("bottom"), stiffness),
        ],
    )
    top = run.record(mpm.Probe("displacement", (0.5, height)))
    run.step()
    run.settle()
    return -run_value(run, top), load / stiffness + load * height / soil.young


def run_value(run, probe: mpm.Probe) -> float:
    """Vertical displacement (m) at a probe now."""
    probe(run)
    return float(probe.values[-1, 1])


if __name__ == "__main__":
    computed, exact = settled()
    print(f"settlement {computed:.6g} m, exact {exact:.6g} m")
