"""Plane waves and free fields in three dimensions."""

import json

from mpi4py import MPI

import numpy as np
import pytest
from earthquakes import ROCK, SOIL, compliant, energy_apart, pulse
from test_ranks import on_ranks

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical.plane_waves import PlaneWaves

H, CELLS = 0.5, 6
TOP = CELLS * H
SIDES = {"left": (0, 0.0), "right": (0, TOP), "back": (2, 0.0), "front": (2, TOP)}
FREQUENCY = SOIL.s_speed / (12 * H)  # 12 cells a wavelength
PULSE = pulse(FREQUENCY)
EDGE = 0.5 * TOP
LAYERS = [(SOIL, lambda x: x[1] > EDGE), (ROCK, lambda x: x[1] < EDGE)]


def ground(wave, angle, azimuth, layer=None, points=False, cells=CELLS):
    """Homogeneous ground that absorbs at its base and four sides, and takes a wave in there."""
    top, beyond = cells * H, 0
    on = layer
    if layer is not None:
        beyond = layer.thickness
    low, high = (-beyond * H,) * 3, ((cells + beyond) * H, top, (cells + beyond) * H)
    grid = mpm.Grid.box(low, high, (cells + 2 * beyond, cells + beyond, cells + 2 * beyond))
    if layer is None:
        on = grid.facets("bottom", *SIDES)
    bears = mpm.ViscousBoundary(on, SOIL) if layer is None else layer
    comes = mpm.IncidentWave(on, SOIL, PULSE, wave=wave, angle=angle, azimuth=azimuth, surface=top)
    stepping, terms = mpm.Newmark(0.5 * H / SOIL.p_speed), [bears, comes]
    if points:
        inside = lambda x: ((x > 0) & (x < top)).all(axis=0)  # noqa: E731
        return mpm.Simulation(grid, mpm.MaterialPoints.fill(grid, SOIL, 8, inside), stepping, terms)
    return mpm.FiniteElements(grid, SOIL, stepping, terms)


def compared(run, wave, angle, azimuth, until, cells=CELLS):
    """Energy of what differs from the exact waves, over the energy of these: the most, and that at
    the end."""
    top, α = cells * H, np.radians(azimuth)
    first = tuple(top * (np.array([np.cos(α), 0.0, np.sin(α)]) < -1e-9))
    soil = SOIL.density, SOIL.p_speed, SOIL.s_speed
    exact = PlaneWaves(wave, angle, *soil, PULSE, first, surface=top, dim=3, azimuth=azimuth)
    return energy_apart(run, exact, (0.0,) * 3, (top,) * 3, until)


@pytest.mark.parametrize(
    "wave, angle, azimuth",
    [
        ("SV", 0.0, 30.0),
        ("P", 0.0, 0.0),
        ("SV", 20.0, 30.0),
        ("P", 25.0, 120.0),
        ("SH", 30.0, 60.0),
    ],
)
def test_waves_come_in_from_five_sides_and_leave(wave, angle, azimuth):
    """What differs is the grid's own dispersion, of 12 cells a wavelength; the pulse takes 2.5
    periods."""
    most, left = compared(ground(wave, angle, azimuth), wave, angle, azimuth, 3.5 / FREQUENCY)
    assert most < 2e-3
    assert left < 1e-8


@pytest.mark.parametrize(
    "wave, angle, azimuth",
    [("SV", 20.0, 30.0), pytest.param("SH", 30.0, 60.0, marks=pytest.mark.validation)],
)
def test_points_take_such_waves_in(wave, angle, azimuth):
    run = ground(wave, angle, azimuth, points=True)
    most, left = compared(run, wave, angle, azimuth, 3.5 / FREQUENCY)
    assert most < 2.5e-3
    assert left < 1e-6


@pytest.mark.validation
@pytest.mark.parametrize("points", [False, True])
def test_a_layer_on_five_sides_takes_such_waves_in(points):
    """A thin one, beside a box of a third of a wavelength."""
    layer, wave = mpm.AbsorbingLayer(("bottom", *SIDES), SOIL, absorbing=2, elastic=1), "SV"
    run = ground(wave, 20.0, 30.0, layer, points, cells=4)
    most, left = compared(run, wave, 20.0, 30.0, 3.5 / FREQUENCY, cells=4)
    assert most < 3e-3
    assert left < 1e-5


# -- free fields -----------------------------------------------------------------------------------


def beneath(**options):
    """What acts on ground and columns alike: the base, the wave and damping."""

    def terms(grid):
        damping = mpm.RayleighDamping(0.05, (0.5 * FREQUENCY, 2.0 * FREQUENCY))
        return [*compliant(grid, motion=PULSE, **options), damping]

    return terms


def level(terms, points=False, tied=False):
    """Damped layers between four free fields, or as a column with tied sides; and the last free
    field."""
    facets = {
        f"{side} {layer}": lambda x, d=d, at=at, up=up: (
            (np.abs(x[d] - at) < 1e-9) & ((x[1] - EDGE) * up > -1e-9)
        )
        for side, (d, at) in SIDES.items()
        for layer, up in (("soil", 1), ("rock", -1))
    }
    across = 1 if tied else CELLS
    high = across * H, TOP, across * H
    grid = mpm.Grid.box((0.0, 0.0, 0.0), high, (across, CELLS, across), not tied and facets)
    on_sides = [mpm.Tied("left", "right"), mpm.Tied("back", "front")] if tied else []
    for side in () if tied else SIDES:
        names = f"{side} soil", f"{side} rock"
        on_sides += [
            mpm.ViscousBoundary(grid.facets(name), law)
            for name, law in zip(names, (SOIL, ROCK), strict=True)
        ]
        on_sides.append(mpm.FreeField(grid.facets(*names), LAYERS, terms))
    stepping, all_terms = mpm.Newmark(0.25 * H / SOIL.s_speed), [*terms(grid), *on_sides]
    if points:
        bodies = [mpm.MaterialPoints.fill(grid, law, 8, of) for law, of in LAYERS]
        return mpm.Simulation(grid, bodies, stepping, all_terms), on_sides[-1]
    return mpm.FiniteElements(grid, LAYERS, stepping, all_terms), on_sides[-1]


@pytest.mark.parametrize(
    "wave, azimuth", [("SV", 30.0), pytest.param("P", 0.0, marks=pytest.mark.validation)]
)
def test_damped_layers_between_four_free_fields_have_no_sides(wave, azimuth):
    run, field = level(beneath(wave=wave, azimuth=azimuth))
    (column,) = field.columns
    x, of = (one.grid.space.tabulate_dof_coordinates()[:, 1] for one in (run, column))
    order = np.argsort(of)[::4]
    off = size = 0.0
    for _ in range(80):
        run.step()
        known = column.nodal("velocity")[order]
        row = np.abs(x[:, None] - of[order]).argmin(axis=1)
        off = max(off, np.abs(run.nodal("velocity") - known[row]).max())
        size = max(size, np.abs(known).max())
    assert size > 0.015
    assert off < 1e-12 * size


@pytest.mark.validation
def test_points_between_four_free_fields_move_as_a_column_of_points():
    """But for what waves in points and in finite elements of the same cells differ by."""
    terms = beneath(azimuth=30.0)
    runs = [level(terms, points=True, tied=tied)[0] for tied in (False, True)]
    tops = [
        run.record(mpm.Probe("velocity", (at, TOP, at)))
        for run, at in zip(runs, (0.5 * TOP, 0.5 * H), strict=True)
    ]
    for run in runs:
        for _ in range(80):
            run.step()
    off = np.abs(tops[0].values - tops[1].values).max()
    assert 0.0 < off < 0.01 * np.abs(tops[1].values).max()


# -- several ranks ---------------------------------------------------------------------------------


def everything():
    """Total energies (J), by part, after a few steps of each scene: the same on any number of
    ranks."""
    layer = mpm.AbsorbingLayer(("bottom", *SIDES), SOIL, absorbing=2, elastic=1)
    record = mpm.Record(PULSE.acceleration(2e-3 * np.arange(200)), 2e-3)
    scenes = {
        "dashpots": lambda: ground("SV", 20.0, 30.0, points=True, cells=4),
        "layer": lambda: ground("SH", 20.0, 30.0, layer, cells=4),
        "free fields": lambda: level(beneath(azimuth=30.0))[0],
        "free fields, points": lambda: level(beneath(azimuth=30.0), points=True)[0],
        "record, tied, damped": lambda: level(
            lambda grid: [*compliant(grid, motion=record), mpm.RayleighDamping(beta=1e-3)],
            points=True,
            tied=True,
        )[0],
    }
    found = {}
    for name, make in scenes.items():
        run = make()
        for _ in range(12):
            run.step()
        comm = run.grid.comm
        found[name] = {part: comm.allreduce(value) for part, value in run.energy().items()}
    return found


@pytest.mark.ranks
@pytest.mark.parametrize("count", [2, 4])
def test_ranks_shake_alike(count):
    known, found = everything(), json.loads(on_ranks(count, __file__).splitlines()[-1])
    for name, energies in known.items():
        size = max(energies.values())
        assert size > 0.0, name
        for part, value in energies.items():
            assert found[name][part] == pytest.approx(value, rel=1e-9, abs=1e-9 * size), name


if __name__ == "__main__":
    found = everything()
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(found))
