"""Plane waves come in through what absorbs."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from earthquakes import ROCK, SOIL, compliant, energy_apart, pulse
from heard import warned
from test_ranks import on_ranks

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical.plane_waves import PlaneWaves

H = 0.5
CELLS = 16
TOP = CELLS * H
PULSE = pulse(SOIL.s_speed / 12.0)  # 24 cells a wavelength


def ground(kind, wave="SV", angle=0.0, courant=0.5, points=False, law=SOIL, **options):
    """A box of ground with what absorbs at its base and its sides, the run and its nodes inside."""
    beyond = 7 if kind == "layer" else 0
    low, high = (-beyond * H, -beyond * H), ((CELLS + beyond) * H, TOP)
    grid = mpm.Grid.box(low, high, (CELLS + 2 * beyond, CELLS + beyond))
    sides = ("left", "right", "bottom")
    if kind == "layer":
        on = mpm.AbsorbingLayer(sides, law)
        terms = [on]
    else:
        on = grid.facets(*sides)
        springs = mpm.ViscoelasticBoundary(on, law, 50.0)
        terms = [springs if kind == "springs" else mpm.ViscousBoundary(on, law)]
    terms.append(mpm.IncidentWave(on, law, PULSE, wave=wave, angle=angle, surface=TOP, **options))
    stepping = mpm.Newmark(courant * H / law.p_speed)
    if points:
        inside = lambda x: (x[0] > 0) & (x[0] < TOP) & (x[1] > 0)  # noqa: E731
        body = mpm.MaterialPoints.fill(grid, law, 4, inside)
        return mpm.Simulation(grid, body, stepping, terms)
    return mpm.FiniteElements(grid, law, stepping, terms)


def compared(run, wave, angle, until):
    """Energy of what differs from the exact waves, over the energy of these: the most, and that at
    the end."""
    exact = PlaneWaves(
        wave, angle, SOIL.density, SOIL.p_speed, SOIL.s_speed, PULSE, (0.0, 0.0), surface=TOP
    )
    return energy_apart(run, exact, (0.0, 0.0), (TOP, TOP), until)


@pytest.mark.parametrize(
    "wave, angle",
    [pytest.param("SV", 0.0, marks=pytest.mark.validation), ("SV", 20.0), ("P", 25.0)],
)
@pytest.mark.parametrize("kind", ["dashpots", "springs", "layer"])
def test_waves_come_in_from_three_sides_and_leave(kind, wave, angle):
    """What differs from the exact waves is the grid's own dispersion, of 24 cells a wavelength and
    more; nothing stays but what boundaries send back."""
    most, left = compared(ground(kind, wave, angle), wave, angle, 0.75)
    assert most < 2.5e-3
    assert left < 1e-5


def test_points_take_waves_in_as_elements_do():
    for kind in ("dashpots", "layer"):
        most, left = compared(ground(kind, angle=20.0, points=True), "SV", 20.0, 0.75)
        assert most < 2e-3
        assert left < 2e-4


def column(bearing, cells=20, **options):
    """A shear column on rock, through dashpots or a layer."""
    beyond = 7 if bearing == "layer" else 0
    grid = mpm.Grid.box((0.0, -beyond * H), (H, cells * H), (1, cells + beyond))
    sides = mpm.Tied("left", "right")
    stepping = mpm.Newmark(0.25 * H / ROCK.s_speed)
    if bearing == "layer":
        layer = mpm.AbsorbingLayer("bottom", ROCK)
        terms = [layer, mpm.IncidentWave(layer, ROCK, pulse(8.0), **options)]
    else:
        terms = compliant(grid, motion=pulse(8.0), **options)
    return mpm.FiniteElements(grid, ROCK, stepping, [sides, *terms])


@pytest.mark.parametrize("kind", ["dashpots", "layer"])
@pytest.mark.parametrize("wave, component", [("SV", 0), ("P", 1)])
def test_a_surface_moves_twice_as_much_as_what_comes_up(kind, wave, component):
    run = column(kind, wave=wave)
    top = run.record(mpm.Probe("velocity", (0.0, 10.0)))
    energy = run.record(mpm.Energy())
    run.until(0.4)
    speed = ROCK.s_speed if wave == "SV" else ROCK.p_speed
    exact = 2 * pulse(8.0).velocity(top.times - 10.0 / speed)
    assert np.abs(top.values[:, component] - exact).max() < 0.01 * np.abs(exact).max()
    assert np.abs(top.values[:, 1 - component]).max() < 1e-12
    work, lost = energy["work"][-1], energy["absorbed"][-1]
    assert lost == pytest.approx(work, rel=2e-5)
    assert work > 0.0


def test_an_outcrop_moves_twice_as_much_as_the_wave():
    runs = [column("dashpots", kind=kind) for kind in ("up-going", "outcrop")]
    found = []
    for run in runs:
        run.until(0.1)
        found.append(run.nodal("velocity").copy())
    assert found[1] == pytest.approx(0.5 * found[0], rel=1e-12, abs=1e-16)


def test_the_balance_of_energy_closes():
    """Of three sides with oblique waves: work done is what was absorbed, stored and moves."""
    for kind in ("dashpots", "springs", "layer"):
        run = ground(kind, angle=20.0)
        energy = run.record(mpm.Energy())
        run.until(0.4)
        sums = {name: energy[name][-1] for name in ("kinetic", "strain", "absorbed", "stored")}
        assert sum(sums.values()) == pytest.approx(energy["work"][-1], rel=1e-10), kind


@pytest.mark.validation
def test_generalised_alpha_and_halved_steps_take_the_same_wave():
    for kind in ("dashpots", "layer"):
        run = ground(kind, angle=20.0)
        run.until(0.2)
        other = ground(kind, angle=20.0)
        stepping = mpm.GeneralizedAlpha(other.stepping.dt, spectral_radius=1.0, start=1.0)
        other = type(other)(other.grid, SOIL, stepping, other.terms)
        other.until(0.2)
        fine = ground(kind, angle=20.0, courant=0.25)
        fine.until(0.2)
        size = np.abs(run.nodal("displacement")).max()
        for one in (other, fine):
            change = np.abs(one.nodal("displacement") - run.nodal("displacement")).max()
            assert change < 0.03 * size, kind


@pytest.mark.parametrize("points", [False, True])
@pytest.mark.parametrize("kind", ["springs", "layer"])
def test_it_goes_on_bit_for_bit(kind, points, tmp_path):
    run, again = (ground(kind, angle=20.0, points=points) for _ in range(2))
    run.record(mpm.Checkpoint(tmp_path / "state", every=20))
    for _ in range(20):
        run.step()
    again.restart(tmp_path / "state")
    for _ in range(5):
        run.step()
        again.step()
    for name, value in run.state().items():
        assert np.array_equal(value, again.state()[name]), name


WRONG = {
    "within": (dict(kind="within"), "the motion of the base itself is no wave, give it by Fixed"),
    "kind": (dict(kind="incoming"), 'kind must be "up-going"'),
    "outcrop": (dict(kind="outcrop", angle=10.0), "moves an outcrop both ways"),
    "motion": (dict(motion=lambda t: t), "motion must be a Record, or Waveform"),
    "wave": (dict(wave="S"), "kind must be|wave must be"),
    "SH": (dict(wave="SH"), "SH"),
    "critical": (dict(angle=50.0, surface=TOP), "critical"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_can_be_no_wave_is_refused(name):
    options, words = WRONG[name]
    grid = mpm.Grid.box((0.0, 0.0), (TOP, TOP), (4, 4))
    with pytest.raises(ValueError, match=words):
        mpm.FiniteElements(grid, SOIL, mpm.Newmark(1e-3), compliant(grid, SOIL, **options))


def test_boundaries_that_do_not_fit_are_refused():
    grid = mpm.Grid.box((0.0, 0.0), (TOP, TOP), (4, 4))
    base, step = grid.facets("bottom"), mpm.Newmark(1e-3)
    wave = mpm.IncidentWave(base, SOIL, PULSE)
    with pytest.raises(ValueError, match="nothing absorbs where IncidentWave comes in"):
        mpm.FiniteElements(grid, SOIL, step, [wave])
    with pytest.raises(ValueError, match="comes through ground of impedances"):
        mpm.FiniteElements(grid, SOIL, step, [wave, mpm.ViscousBoundary(base, ROCK)])
    sides = grid.facets("bottom", "left")
    with pytest.raises(ValueError, match="give its height"):
        absorbing = mpm.ViscousBoundary(sides, SOIL)
        mpm.FiniteElements(grid, SOIL, step, [absorbing, mpm.IncidentWave(sides, SOIL, PULSE)])
    layer = mpm.AbsorbingLayer("bottom", ROCK, absorbing=1, elastic=1)
    with pytest.raises(ValueError, match="none of the scene's terms"):
        mpm.FiniteElements(grid, SOIL, step, [mpm.IncidentWave(layer, ROCK, PULSE)])
    with pytest.raises(ValueError, match="its AbsorbingLayer is of"):
        mpm.FiniteElements(grid, ROCK, step, [layer, mpm.IncidentWave(layer, SOIL, PULSE)])
    with pytest.raises(ValueError, match="needs velocities"):
        mpm.FiniteElements(grid, SOIL, mpm.QuasiStatic(1), [wave])


def test_waves_on_each_side_apart_are_one_wave():
    sides, runs = ("left", "right", "bottom"), []
    for parts in ([sides], [(side,) for side in sides]):
        grid = mpm.Grid.box((0.0, 0.0), (TOP, TOP), (CELLS, CELLS))
        terms = []
        for names in parts:
            on = grid.facets(*names)
            wave = mpm.IncidentWave(on, SOIL, PULSE, angle=-20.0, surface=TOP)
            terms += [mpm.ViscousBoundary(on, SOIL), wave]
        runs.append(mpm.FiniteElements(grid, SOIL, mpm.Newmark(5e-3), terms))
    for run in runs:
        run.until(0.3)
    one, three = (run.nodal("displacement") for run in runs)
    assert three == pytest.approx(one, rel=1e-12, abs=1e-12 * np.abs(one).max())


def test_waves_that_move_nothing_or_cannot_be_are_refused():
    grid = mpm.Grid.box((0.0, 0.0), (H, TOP), (1, 4))
    base, step = grid.facets("bottom"), mpm.Newmark(1e-3)
    dashpots = mpm.ViscousBoundary(base, SOIL)
    wave = mpm.IncidentWave(base, SOIL, PULSE)
    oblique = mpm.IncidentWave(base, SOIL, PULSE, angle=10.0)
    for terms, words in (
        ([mpm.Tied("left", "right"), oblique], "angle: a wave at 10° is not the same at both"),
        ([mpm.Fixed(base, "x"), wave], "Fixed holds x where IncidentWave comes in"),
        ([mpm.Fixed(base), mpm.IncidentWave(base, SOIL, PULSE, wave="P")], "Fixed holds y"),
    ):
        with pytest.raises(ValueError, match=words):
            mpm.FiniteElements(grid, SOIL, step, [dashpots, *terms])
    mpm.FiniteElements(grid, SOIL, step, [dashpots, mpm.Fixed(base, "y"), wave])
    for on in ("bottom", None):
        with pytest.raises(ValueError, match="on must be a surface"):
            mpm.IncidentWave(on, SOIL, PULSE)
    with pytest.raises(ValueError, match="surface must be a number"):
        mpm.IncidentWave(base, SOIL, PULSE, surface="0")
    body = mpm.MaterialPoints.fill(grid, SOIL, 4, lambda x: x[1] > 0.5 * TOP)
    with pytest.raises(ValueError, match="no material is beside"), pytest.warns(UserWarning):
        mpm.Simulation(grid, body, step, [dashpots, wave])


def test_a_surface_elsewhere_is_told_of():
    grid = mpm.Grid.box((0.0, 0.0), (TOP, TOP), (4, 4))
    sides = grid.facets("left", "bottom")

    def build(surface):
        wave = mpm.IncidentWave(sides, SOIL, PULSE, surface=surface)
        terms = [mpm.ViscousBoundary(sides, SOIL), wave]
        return lambda: mpm.FiniteElements(grid, SOIL, mpm.Newmark(1e-3), terms)

    assert warned(build(TOP)) == []
    (words,) = warned(build(TOP + 3.0))
    assert "free surface to be at y = 11 m" in words and "end at 8 m" in words


def test_units_that_cannot_be_and_late_starts_are_told_of():
    def build(motion, dt=1e-3):
        grid = mpm.Grid.box((0.0, 0.0), (TOP, TOP), (4, 4))
        return lambda: mpm.FiniteElements(
            grid, SOIL, mpm.Newmark(dt), compliant(grid, SOIL, motion)
        )

    assert warned(build(PULSE)) == []
    (words,) = warned(build(pulse(5.0, peak=50.0)))
    assert re.search(r"accelerates by 1\.53e\+03 m/s².*cm/s²", words)
    (words,) = warned(build(pulse(5.0, begin=0.1)))
    assert "moves the boundary at t = 0 already" in words
    sudden = mpm.Record(np.sin(20.0 * 1e-3 * np.arange(400)), 1e-3)
    grid = mpm.Grid.box((0.0, 0.0), (TOP, TOP), (4, 4))
    above = compliant(grid, SOIL, sudden, origin=(0.0, TOP))
    said = warned(lambda: mpm.FiniteElements(grid, SOIL, mpm.Newmark(1e-3), above))
    assert any("moves the boundary at t = 0 already" in words for words in said)
    wrong = replace(PULSE, acceleration=lambda t: 100.0 * PULSE.acceleration(t))
    with pytest.raises(ValueError, match="acceleration of the waveform is not the rate"):
        build(wrong)()


RANKS = f"""
import sys
from mpi4py import MPI
sys.path.insert(0, {str(Path(__file__).parent)!r})
import test_incident_wave as t
comm = MPI.COMM_WORLD
for kind, points in (("dashpots", False), ("layer", False), ("layer", True)):
    run = t.ground(kind, angle=20.0, points=points)
    run.until(0.2)
    energy = sum(comm.allreduce(value) for value in run.energy().values())
    if comm.rank == 0:
        print(kind, points, energy)
"""


@pytest.mark.ranks
def test_ranks_take_the_same_wave():
    one, two = (on_ranks(n, "-c", RANKS).split() for n in (1, 2))
    assert one[::3] == two[::3]
    assert [float(e) for e in two[2::3]] == pytest.approx([float(e) for e in one[2::3]], rel=1e-9)
