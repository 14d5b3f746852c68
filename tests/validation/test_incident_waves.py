"""Case 26: oblique waves come into a half-space through three sides.

Exact: the incoming wave and what the free surface sends back of it (``analytical.plane_waves``).
What is scattered is the energy of the velocities' difference from that, in the box, over the most
energy of the exact ones: the dispersion of 32 cells a wavelength of S waves in it, and what the
boundaries send back.  The box is one and a half wavelengths wide and one deep.
"""

import numpy as np
import pytest
from earthquakes import pulse
from methods import over

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical.plane_waves import PlaneWaves

pytestmark = pytest.mark.validation

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=2000.0)
ACROSS, DEEP, H = 48, 32, 1.0
FREQUENCY = SOIL.s_speed / (32 * H)
TOP = DEEP * H


PULSE = pulse(FREQUENCY, peak=0.01)


def within(x):
    """Which places (dim, n) lie in the box."""
    return (x[0] > -1e-9) & (x[0] < ACROSS * H + 1e-9) & (x[1] > -1e-9)


def scattered(kind, wave, angle, mapping):
    """The most energy that differs, that left at the end, and the error of the surface's peak."""
    beyond = 7 if kind == "layer" else 0
    width = ACROSS * H
    low, high = (-beyond * H, -beyond * H), (width + beyond * H, TOP)
    grid = mpm.Grid.box(low, high, (ACROSS + 2 * beyond, DEEP + beyond))
    sides = "left", "right", "bottom"
    if kind == "layer":
        on = mpm.AbsorbingLayer(sides, SOIL)
        terms = [on]
    else:
        on = grid.facets(*sides)
        terms = [mpm.ViscousBoundary(on, SOIL)]
    terms.append(mpm.IncidentWave(on, SOIL, PULSE, wave=wave, angle=angle, surface=TOP))
    stepping = mpm.Newmark(0.5 * H / SOIL.p_speed)
    if mapping is None:
        run = mpm.FiniteElements(grid, SOIL, stepping, terms)
    else:
        body = mpm.MaterialPoints.fill(grid, SOIL, 4, within)
        run = mpm.Simulation(grid, body, stepping, terms, mapping)
    places, read = run.sampler("velocity")
    rows = np.flatnonzero(
        (places[:, 0] > -1e-9) & (places[:, 0] < width + 1e-9) & (places[:, 1] > -1e-9)
    )
    x = places[rows]
    speeds = SOIL.density, SOIL.p_speed, SOIL.s_speed
    exact = PlaneWaves(wave, angle, *speeds, PULSE, (0.0, 0.0), surface=TOP)
    middle = np.argmin(np.hypot(x[:, 0] - 0.5 * width, x[:, 1] - TOP))
    differs, energy, surface = [], [], []
    until = 2.4 / FREQUENCY + (2 * TOP + width) / SOIL.s_speed
    while run.time < until:
        run.step()
        found, wanted = read(rows), exact.velocity(run.time, x)
        differs.append(((found - wanted) ** 2).sum())
        energy.append((wanted**2).sum())
        surface.append((np.hypot(*found[middle]), np.hypot(*wanted[middle])))
    found, wanted = np.max(surface, axis=0)
    return max(differs) / max(energy), differs[-1] / max(energy), abs(found / wanted - 1)


WAVES = [("SV", 10.0), ("SV", 20.0), ("SV", 30.0), ("P", 10.0), ("P", 25.0), ("P", 40.0)]


@over(None, mpm.DM_GC)
@pytest.mark.parametrize("kind", ["dashpots", "layer"])
def test_waves_come_in_and_go_out(kind, mapping, record):
    found = np.array([scattered(kind, wave, angle, mapping) for wave, angle in WAVES])
    most, left, peak = found.max(axis=0)
    record(f"26 oblique waves, {kind}: energy scattered", mapping, most)
    record(f"26 oblique waves, {kind}: energy left behind", mapping, left)
    record(f"26 oblique waves, {kind}: peak of the surface", mapping, peak)
    assert most < 1e-3
    assert left < (1e-6 if kind == "layer" and mapping is None else 1e-4)
    assert peak < 0.01
