"""Case 10: Lamb's problem, a line load on a half-space; a surface wave runs off at
``analytical.waves.rayleigh_speed``.

In the plane it neither decays nor spreads, whereas body waves along the surface fall off like
x^-3/2: the delay of two receivers far out is that of the surface wave.
"""

from itertools import product

import numpy as np
import pytest
from methods import LINEAR, POINTS, TILING, name

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical.waves import rayleigh_speed

pytestmark = pytest.mark.validation

NEAR, FAR, WIDE, DEEP = 4, 8, 10, 3  # receivers and extent in wavelengths


def surface_speed(mapping, poisson, wave=12):
    """Speed of the surface wave over c_s, from two receivers of vertical velocity; ``wave``: its
    length in cells."""
    soil = mpm.LinearElastic(20e6, poisson, 1500.0)
    width, depth = WIDE * wave, DEEP * wave
    above = 0 if mapping is None else 2
    grid = mpm.Grid.box(
        (0, -depth - above), (width + above, above), (width + above, depth + 2 * above)
    )
    if mapping is None:
        side, base, top = grid.facets("right"), grid.facets("bottom"), grid.facets("top")
    else:
        body = mpm.MaterialPoints.fill(
            grid, soil, 4, inside=lambda x: (x[0] < width) & (x[1] > -depth) & (x[1] < 0)
        )
        side, base, top = (body.surface(name) for name in ("right", "bottom", "top"))
    period = wave / soil.s_speed
    stepping = mpm.Newmark(0.5 / soil.s_speed)

    def load(t, x):
        s = (np.pi * (t / period - 1.5)) ** 2
        pull = np.zeros_like(x)
        pull[:, 1] = (1 - 2 * s) * np.exp(-s) * np.exp(-((x[:, 0] / (wave / 6)) ** 2))
        return pull

    terms = [
        mpm.Fixed(grid.facets("left"), "x"),
        mpm.Traction(top, load),
        mpm.ViscousBoundary(side, soil),
        mpm.ViscousBoundary(base, soil),
    ]
    run = (
        mpm.FiniteElements(grid, soil, stepping, terms)
        if mapping is None
        else mpm.Simulation(grid, body, stepping, terms, mapping)
    )
    place, read = run.sampler("velocity")
    rows = [np.hypot(place[:, 0] - n * wave, place[:, 1]).argmin() for n in (NEAR, FAR)]
    steps = int((FAR + 4) * wave / 0.87 / 0.5)
    found = np.zeros((steps, 2))
    for i in range(steps):
        run.step()
        found[i] = read(np.array(rows))[:, 1]
    near, far = found.T
    match = np.correlate(far, near, "full")
    i = match.argmax()
    i = i + 0.5 * (match[i - 1] - match[i + 1]) / (match[i - 1] - 2 * match[i] + match[i + 1])
    delay = (i - steps + 1) * stepping.dt
    return np.diff(place[rows, 0])[0] / delay / soil.s_speed


@pytest.mark.parametrize(
    "mapping, poisson",
    [*product((None, *POINTS), (0.25,)), *product((None, mpm.DM_GC), (0.3, 0.41))],
    ids=name,
)
def test_speed_of_the_surface_wave(mapping, poisson, record):
    """Twelve cells a wavelength; bilinear finite elements make such waves 1 % too fast, half as
    long ones 4 %.

    Linear weights come as near, 2.1 and 1.8 %, and nearer than elements: the dashpots act on nodes
    that no point reaches once an edge is a hair past a grid line, but these follow the body.  While
    they were on their own what came of it was a matter of round-off: 3.9 %, 15 % or no wave at all.
    """
    exact = rayleigh_speed(poisson)
    error = surface_speed(mapping, poisson) / exact - 1
    bound = 0.0075 if mapping is mpm.DM_GC else 0.0107 if mapping in TILING else 0.029
    record(
        f"10 Lamb, ν = {poisson:g}: speed of the surface wave ({exact:.4f} c_s)",
        mapping,
        abs(error),
    )
    assert abs(error) < (0.0235 if mapping in LINEAR else bound)


def test_finite_elements_come_nearer_with_smaller_cells():
    coarse, fine = (surface_speed(None, 0.25, wave) / rayleigh_speed(0.25) - 1 for wave in (8, 12))
    assert np.log(coarse / fine) / np.log(1.5) > 1.3
