"""Case 12: a wave comes in through a compliant base, dashpots or a layer of cells, runs up 260 m of
elastic soil and down again.

Exact: accelerations at the base are those of v_up, up at t and down at t + 2L/c, and twice that at
the surface at t + L/c.  v_up = 9.806 t exp(−(10πt)²) m/s for shear: 1 g at its middle.
"""

import numpy as np
import pytest
from methods import LINEAR, METHODS, over

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical.waves import relative_error

pytestmark = pytest.mark.validation

ROCK = mpm.LinearElastic(young=3e9, poisson=0.3, density=2100.0)
L, H, G, START = 260.0, 2.0, 9.806, 0.15
RATE = (10 * np.pi) ** 2
LAYER = 7  # cells of AbsorbingLayer


def displacement(t):
    """Its integral (m)."""
    return -G / (2 * RATE) * np.exp(-RATE * (t - START) ** 2)


def velocity(t):
    """v_up at the base (m/s)."""
    return G * (t - START) * np.exp(-RATE * (t - START) ** 2)


def acceleration(t):
    """Its derivative (m/s²)."""
    s = t - START
    return G * (1 - 2 * RATE * s**2) * np.exp(-RATE * s**2)


def shake(mapping, courant=0.5, bearing="dashpots"):
    """Times (n,) and horizontal accelerations (n,) at the base and the surface, and their
    heights."""
    cells, room = round(L / H), 0 if mapping is None else 2
    stepping = mpm.Newmark(courant * H / ROCK.s_speed)
    low, high = (-LAYER if bearing == "layer" else -room), cells + room
    grid = mpm.Grid.box((0, low * H), (H, high * H), (1, high - low))
    if mapping is not None:
        body = mpm.MaterialPoints.fill(grid, ROCK, 4, inside=lambda x: (x[1] > 0) & (x[1] < L))
    if bearing == "layer":
        base = absorbing = mpm.AbsorbingLayer("bottom", ROCK)
    else:
        base = grid.facets("bottom") if mapping is None else body.surface("bottom")
        absorbing = mpm.ViscousBoundary(base, ROCK)
    sides = mpm.Tied("left", "right")
    if mapping is mpm.DM_GCL:  # which does not go on over tied sides
        sides = mpm.Fixed(grid.facets("left", "right"), "y")
    motion = mpm.Waveform(displacement, velocity, acceleration)
    terms = [sides, absorbing, mpm.IncidentWave(base, ROCK, motion)]
    run = (
        mpm.FiniteElements(grid, ROCK, stepping, terms)
        if mapping is None
        else mpm.Simulation(grid, body, stepping, terms, mapping)
    )
    place, read = run.sampler("acceleration")
    inside = np.where(place[:, 1] > -1e-9 * L, place[:, 1], np.inf)
    rows = np.array([inside.argmin(), place[:, 1].argmax()])
    t, found = [], []
    while run.time < 2 * L / ROCK.s_speed + 2 * START:
        run.step()
        t.append(run.time)
        found.append(read(rows)[:, 0])
    return np.array(t), np.array(found), place[rows, 1]


def peaks_of(t, found):
    """Peaks (3,) of the base up and down, and half that of the surface, of 1 g."""
    up = t < L / ROCK.s_speed + START
    base, surface = found.T
    return np.array([base[up].max(), base[~up].max(), surface.max() / 2]) / G


@METHODS
def test_one_g_goes_up_two_g_arrive_and_one_comes_down(mapping, record):
    """Two metres a cell, 37 a wavelength at the middle of the spectrum; L2 over the run has the
    tails of dispersion, which composite strain on linear weights makes a fifth longer."""
    t, found, y = shake(mapping)
    base, surface = found.T
    peaks = peaks_of(t, found)
    below, above = (
        acceleration(t - x / ROCK.s_speed) + acceleration(t - (2 * L - x) / ROCK.s_speed) for x in y
    )
    tails = 0.06 if mapping in LINEAR and mapping.composite else 0.05
    record(
        "12 compliant base: peaks of 1 g at the base, 2 g above", mapping, np.abs(peaks - 1).max()
    )
    record(
        "12 compliant base: accelerations (L2)",
        mapping,
        max(relative_error(base, below), relative_error(surface, above)),
    )
    assert np.abs(peaks - 1).max() < 0.01
    assert relative_error(base, below) < tails
    assert relative_error(surface, above) < tails


@over(None, mpm.CMPM, mpm.DM_G, mpm.DM_GC)
def test_the_error_at_the_surface_is_of_second_order(mapping, monkeypatch):
    error = []
    for h in (2.0, 1.0):
        monkeypatch.setitem(globals(), "H", h)
        t, found, y = shake(mapping)
        exact = acceleration(t - y[1] / ROCK.s_speed) + acceleration(
            t - (2 * L - y[1]) / ROCK.s_speed
        )
        error.append(relative_error(found[:, 1], exact))
    assert np.log2(error[0] / error[1]) > 1.8


@over(None, mpm.DM_GC)
def test_a_layer_takes_it_in_as_dashpots_do(mapping, record, monkeypatch):
    """Peaks from exact, and from those by dashpots, with cells of 1 m: half of 2 m, a quarter of
    the error."""
    monkeypatch.setitem(globals(), "H", 1.0)
    by_dashpots, by_layer = (
        peaks_of(*shake(mapping, bearing=bearing)[:2]) for bearing in ("dashpots", "layer")
    )
    wrong = [np.abs(peaks - 1).max() for peaks in (by_dashpots, by_layer)]
    apart = np.abs(by_layer - by_dashpots).max()
    for bearing, error in zip(("dashpots", "layer"), wrong, strict=True):
        record(f"12 compliant base, {bearing}, h = 1 m: peaks of 1 g and 2 g", mapping, error)
    record("12 compliant base, layer, h = 1 m: peaks against those by dashpots", mapping, apart)
    assert max(wrong) < 0.006
    assert apart < 0.001
