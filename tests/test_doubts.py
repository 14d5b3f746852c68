"""What a newcomer does by mistake is refused or warned of: overlaps, doubled dashpots, units, laws
of total strain, reactions of what is not at rest."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import ufl
from dolfinx import fem
from heard import warned

import mpm_fenicsx as mpm

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=2000.0)
STIFF = replace(SOIL, young=80e6)


def layers(bottom, top, gap=(2.0, 2.0), soil=SOIL):
    """Two bodies on a column of cells of 0.5 m, the lower up to gap[0], the upper from gap[1]."""
    grid = mpm.Grid.box((0, 0), (0.5, 4.5), (1, 9))
    inside = lambda x: x[1] < gap[0], lambda x: (x[1] > gap[1]) & (x[1] < 4)
    bodies = [
        mpm.MaterialPoints.fill(grid, s, 4, inside=i)
        for s, i in zip((bottom, top), inside, strict=True)
    ]
    return grid, bodies


def sides(grid):
    return mpm.Fixed(grid.facets("left", "right"), "x")


@pytest.mark.parametrize("top", [SOIL, STIFF], ids=["of one soil", "of two"])
def test_bodies_that_overlap_are_refused(top):
    grid, bodies = layers(SOIL, top, gap=(2.0, 0.0))
    with pytest.raises(ValueError, match=r"bodies 0 and 1 overlap: together they fill the cell at"):
        mpm.Simulation(grid, bodies, mpm.Newmark(1e-3), [sides(grid)])
    grid, bodies = layers(SOIL, top)
    mpm.Simulation(grid, bodies, mpm.Newmark(1e-3), [sides(grid)])


def test_overlap_of_half_a_cell_is_refused_and_an_interface_inside_a_cell_is_not():
    for low, high, wrong in ((2.25, 2.0, True), (2.25, 2.25, False)):
        grid, bodies = layers(SOIL, SOIL, gap=(low, high))
        if wrong:
            with pytest.raises(ValueError, match="overlap"):
                mpm.Simulation(grid, bodies, mpm.Newmark(1e-3), [sides(grid)])
        else:
            mpm.Simulation(grid, bodies, mpm.Newmark(1e-3), [sides(grid)])


def test_dashpots_twice_on_one_surface_are_warned_of():
    grid, (low, up) = layers(SOIL, SOIL)
    base = low.surface("bottom")
    twice = [mpm.ViscousBoundary(base, SOIL), mpm.ViscoelasticBoundary(base, SOIL, 10.0)]
    (found,) = warned(
        lambda: mpm.Simulation(grid, [low, up], mpm.Newmark(1e-3), [sides(grid), *twice])
    )
    assert found.startswith("ViscousBoundary and ViscoelasticBoundary act on the same surface")
    ground = mpm.Grid.box((0, 0), (1, 2), (2, 4))
    twice = [
        mpm.ViscousBoundary(ground.facets(*s), SOIL) for s in (("bottom",), ("left", "bottom"))
    ]
    (found,) = warned(lambda: mpm.FiniteElements(ground, SOIL, mpm.Newmark(1e-3), twice))
    assert "their dashpots add up" in found
    twice = [mpm.ViscousBoundary(ground.facets(s), SOIL) for s in ("bottom", "left")]
    assert not warned(lambda: mpm.FiniteElements(ground, SOIL, mpm.Newmark(1e-3), twice))


def test_dashpots_inside_the_soil_are_warned_of():
    grid, (low, up) = layers(SOIL, SOIL)
    for body, expected in ((up, 1), (low, 0)):
        grid, (low, up) = layers(SOIL, SOIL)
        body = up if expected else low
        term = mpm.ViscousBoundary(body.surface("bottom"), SOIL)
        found = warned(
            lambda term=term, low=low, up=up, grid=grid: mpm.Simulation(
                grid, [low, up], mpm.Newmark(1e-3), [sides(grid), term]
            )
        )
        assert len(found) == expected
        assert all("acts on a surface inside the soil: in front of 4 of its 4" in m for m in found)


def test_a_step_of_wrong_units_is_warned_of():
    grid, bodies = layers(SOIL, SOIL)
    terms = [sides(grid), mpm.Fixed(grid.facets("bottom"), "y")]
    run = mpm.Simulation(grid, bodies, mpm.Newmark(2.0), terms)
    with pytest.warns(UserWarning, match=r"P waves run through 438 cells a step.*units of dt"):
        run.step()


def test_reactions_of_what_is_not_at_rest_are_warned_of():
    grid, bodies = layers(SOIL, SOIL)
    terms = [sides(grid), mpm.Fixed(grid.facets("bottom"), "y"), mpm.Gravity((0.0, -9.81))]
    run = mpm.Simulation(grid, bodies, mpm.QuasiStatic(1), terms)
    run.step()
    base = bodies[0].surface("bottom")
    with pytest.warns(UserWarning, match=r"out of balance by .* settle\(\) first"):
        run.reactions(base)
    run.settle()
    assert not warned(lambda: run.reactions(base))


# -- laws ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Own(mpm.OnElastic):
    """Elastic, written as a law that is not linear."""

    elastic: mpm.LinearElastic
    total: bool = False
    times: float = 1.0

    history = ("plastic_work",)

    def tangent(self, strain, stress, history, given=()):
        dim = 2 if strain.shape[1] == 4 else 3
        D = self.times * np.tile(mpm.stiffness(self.lame, dim), (len(strain), 1, 1))
        added = np.einsum("nij,nj->ni", D, strain)
        return (added if self.total else stress + added), history.copy(), D


def test_a_law_of_total_strain_is_refused_and_one_whose_lame_are_others_warned_of():
    grid = mpm.Grid.box((0, 0), (1, 1), (2, 2))
    mpm.MaterialPoints.fill(grid, Own(SOIL), 4)
    with pytest.raises(
        ValueError, match=r"without any strain Own makes of the stress .* increment"
    ):
        mpm.MaterialPoints.fill(grid, Own(SOIL, total=True), 4)
    with pytest.raises(ValueError, match="without any strain"):
        mpm.FiniteElements(grid, Own(SOIL, total=True), mpm.QuasiStatic(1), [])
    with pytest.warns(UserWarning, match="the tangent of Own at rest has entries up to"):
        mpm.MaterialPoints.fill(grid, Own(SOIL, times=20.0), 4)


# -- recorders -------------------------------------------------------------------------------------


class Velocities(mpm.Series):
    def attach(self, run):
        self(run)

    def __call__(self, run):
        self.note(run, run.nodal("velocity"))


def test_a_series_keeps_copies():
    """Free fall: v = g t at every node, at every time that was recorded."""
    grid = mpm.Grid.box((0, 0), (1, 1), (2, 2))
    run = mpm.FiniteElements(grid, SOIL, mpm.Newmark(1e-3), [mpm.Gravity((0.0, -10.0))])
    found = run.record(Velocities())
    run.until(0.01)
    exact = np.broadcast_to(-10.0 * found.times[:, None], found.values.shape[:2])
    np.testing.assert_allclose(found.values[:, :, 1], exact, atol=1e-12)


def test_recorders_that_cannot_be_are_refused_in_words():
    grid = mpm.Grid.box((0, 0), (1, 1), (2, 2))
    run = mpm.FiniteElements(grid, SOIL, mpm.Newmark(1e-3), [mpm.Gravity((0.0, -10.0))])
    energy = run.record(mpm.Energy())
    for recorder, message in (
        (energy, "this run has it already"),
        (mpm.Energy, "call it with what it asks for"),
        (lambda run: None, r"this has no attach\(run\)"),
    ):
        with pytest.raises(ValueError, match=message):
            run.record(recorder)
    series = Velocities()
    series.note(run, np.zeros(2))
    with pytest.raises(ValueError, match=r"a value has shape \(3,\), those before \(2,\)"):
        series.note(run, np.zeros(3))


# -- terms of one's own whose stiffness changes ----------------------------------------------------


class Stiffening:
    """A bed of springs, k up to half of the time and 10 k from then on."""

    holds = True

    def __init__(self, on, k):
        self.on, self.k = on, k

    def bind(self, scene):
        motion = scene.motion
        borne = fem.Function(scene.grid.space)
        k = fem.Constant(scene.grid.mesh, self.k)

        def before(start, end):
            k.value = np.array(self.k if start < 0.49 else 10 * self.k)

        def after():
            borne.x.array[:] += float(k.value) * motion.u.x.array

        work = ufl.inner(motion.known(borne) + k * motion.u, motion.w)
        return mpm.Contribution(
            work * scene.patch(self.on).measure,
            before=[before],
            after=[after],
            memory={"borne": borne.x.array},
            holds=True,
        )


@pytest.mark.parametrize(
    "law", [SOIL, mpm.VonMises(SOIL, 1e9, 1e9, 0.0)], ids=["elastic", "yields"]
)
def test_finite_elements_see_that_a_coefficient_has_changed(law):
    """1 kPa in twenty steps on springs of 1e5 Pa/m, then of 1e6: 5 mm + 0.5 mm."""
    grid = mpm.Grid.box((0, 0), (1, 2), (2, 4))
    terms = [
        sides(grid),
        mpm.Traction(grid.facets("top"), lambda t: (0.0, -1e3 * t)),
        Stiffening(grid.facets("bottom"), 1e5),
    ]
    run = mpm.FiniteElements(grid, law, mpm.QuasiStatic(20), terms)
    probe = run.record(mpm.Probe("displacement", (0.5, 0.0)))
    run.until(1.0)
    assert probe.values[-1, 1] == pytest.approx(-5.5e-3, rel=1e-9)


class Coupled:
    """Springs that pull aslant: not symmetric."""

    def __init__(self, on, symmetric):
        self.on, self.symmetric = on, symmetric

    def bind(self, scene):
        motion = scene.motion
        work = 1e7 * (ufl.inner(motion.u, motion.w) + motion.u[1] * motion.w[0])
        return mpm.Contribution(work * scene.patch(self.on).measure, symmetric=self.symmetric)


def test_in_dynamics_finite_elements_too_see_a_matrix_that_is_askew():
    grid = mpm.Grid.box((0, 0), (2, 1), (4, 2))
    load = mpm.Traction(grid.facets("top"), (0.0, -1e3))

    def run(symmetric):
        terms = [load, Coupled(grid.facets("bottom"), symmetric)]
        return mpm.FiniteElements(grid, SOIL, mpm.Newmark(1e-2), terms)

    run(False).step()
    with pytest.raises(mpm.RunError, match="the matrix is askew by"):
        run(True).step()


# -- restart ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change", [{"sweeps": 0}, {"stress": mpm.DOUBLE_MAPPED}, {"hold_cut_cells": False}], ids=str
)
def test_a_restart_needs_the_same_mapping(change, tmp_path):
    def run(mapping):
        grid, bodies = layers(SOIL, SOIL)
        terms = [sides(grid), mpm.Fixed(grid.facets("bottom"), "y"), mpm.Gravity((0.0, -9.81))]
        return mpm.Simulation(grid, bodies, mpm.Newmark(1e-3), terms, mapping)

    first = run(mpm.DM_GC)
    first.record(mpm.Checkpoint(tmp_path / "state"))
    first.step()
    run(replace(mpm.DM_GC, transfer=mpm.flip)).restart(tmp_path / "state")
    other = run(replace(mpm.DM_GC, **change))
    (name,) = change
    assert f"with {name}=" in str(other)
    with pytest.raises(ValueError, match=f"mapping is .*{name}="):
        other.restart(tmp_path / "state")
