"""Ground that waves come up through, and the pulse that they are."""

import numpy as np

import mpm_fenicsx as mpm

SOIL = mpm.LinearElastic(young=20e6, poisson=0.3, density=1800.0)
ROCK = mpm.LinearElastic(young=200e6, poisson=0.3, density=2100.0)


def pulse(frequency: float, begin: float = 1.2, peak: float = 0.01) -> mpm.Waveform:
    """Ricker's pulse of velocity (m/s) with its middle ``begin`` periods after the start."""
    return mpm.Waveform.ricker(frequency, peak, begin / frequency)


def compliant(grid, law=ROCK, motion=None, **options) -> list:
    """A base of that rock, and the wave that comes up through it."""
    base = grid.facets("bottom")
    wave = mpm.IncidentWave(base, law, motion or pulse(4.0), **options)
    return [mpm.ViscousBoundary(base, law), wave]


def energy_apart(run, exact, low, high, until) -> tuple[float, float]:
    """Energy of velocities that differ from exact waves between two corners (dim,), m, over the
    most energy of these: the most until a time (s), and that at the end."""
    place, read = run.sampler("velocity")
    inside = ((place > np.array(low) - 1e-9) & (place < np.array(high) + 1e-9)).all(axis=1)
    rows, x = np.flatnonzero(inside), place[inside]
    differs, energy = [], []
    while run.time < until:
        run.step()
        v = exact.velocity(run.time, x)
        differs.append(((read(rows) - v) ** 2).sum())
        energy.append((v**2).sum())
    return max(differs) / max(energy), differs[-1] / max(energy)
