"""The bars of the studies: what they start from, what they measure, and the orders at which they
must converge."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import manufactured_causes

from mpm_fenicsx import DM_GC, GIMP, MPM
from mpm_fenicsx.scenes import bar as bars
from mpm_fenicsx.scenes.bar import BARS, Watch


def errors(name, mapping, cells):
    bar = BARS[name]
    cell, dt = 1 / cells, bar.period / (4 * cells)
    run = (
        bars.finite_elements(bar, cell, dt)
        if mapping is None
        else bars.material_points(bar, mapping, cell, dt, 4, name == "random")
    )
    watch = Watch(run, bar)
    while run.steps < 4 * cells:
        run.step()
        watch()
    return np.array(list(watch.errors().values()))


def orders(name, mapping, coarse=10):
    return np.log2(errors(name, mapping, coarse) / errors(name, mapping, 2 * coarse))


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_tiles_tile(jitter):
    body = bars.tiles(bars.material(BARS["moving"]), 0.05, jitter)
    assert body.volume.sum() == pytest.approx(bars.length * bars.height, rel=1e-13)
    row = body.x[:, 1] == body.x[0, 1]
    x, half = body.x[row, 0], body.half[row, 0]
    np.testing.assert_allclose((x + half)[:-1], (x - half)[1:], atol=1e-14)
    assert np.ptp(half) > 0.01 if jitter else np.ptp(half) < 1e-15


@pytest.mark.parametrize("mapping", [GIMP, DM_GC], ids=str)
def test_a_bar_that_only_drifts_stays_as_it_is(mapping):
    bar = replace(BARS["moving"], amplitude=0.0)
    run = bars.material_points(bar, mapping, 0.1, bar.period / 40, 4, random=True)
    body, X = run.bodies[0], run.bodies[0].x.copy()
    run.until(bar.period)
    assert run.steps == 40
    np.testing.assert_allclose(body.x - X, [[0.2, 0.0]] * len(body), atol=1e-11)
    assert np.abs(body.stress).max() < 1e-9 * bars.young


@pytest.mark.parametrize("name", ["moving", "large"])
def test_the_watch_sees_nothing_where_nothing_is_wrong_and_one_percent_where_that_is(name):
    bar = BARS[name]
    run = bars.material_points(bar, MPM, 0.1, bar.period / 40, 4, random=True)
    right, wrong = Watch(run, bar), Watch(run, bar)
    body, X, run.steps = run.bodies[0], run.bodies[0].x[:, 0].copy(), 7
    body.stress[:, 0] = bar.stress(X, run.time)
    body.velocity[:, 0] = bar.drift + bar.velocity(X, run.time)
    body.x[:, 0] = X + bar.drift * run.time + bar.displacement(X, run.time)
    right()
    assert max(right.errors().values()) < 1e-9
    body.stress *= 1.01
    body.x[:, 0] += 0.01 * bar.displacement(X, run.time)
    wrong()
    assert wrong.errors()["error_stress"] == pytest.approx(0.01, rel=1e-6)
    assert wrong.errors()["error_displacement"] == pytest.approx(0.01, rel=1e-6)


@pytest.mark.parametrize("name", ["standing", "moving", "large"])
def test_finite_elements_are_of_second_order(name):
    assert (orders(name, None) > 1.85).all()


def test_at_rest_dm_gc_is_of_second_order_where_the_stress_of_mpm_is_of_first():
    displacement, _, stress = orders("standing", DM_GC)
    assert displacement > 1.85 and stress > 1.85
    assert orders("standing", MPM)[2] < 1.1


def test_crossing_cells_dm_gc_converges_and_mpm_does_not():
    assert (orders("large", DM_GC)[[0, 2]] > [1.85, 1.4]).all()
    assert (orders("large", MPM) < 0.0).all()


def test_double_mapped_mass_and_constant_stress_are_what_costs_the_order():
    rows = {
        way: [
            np.array(
                list(manufactured_causes.measure("moving", DM_GC, way, cells).values())[4:], float
            )
            for cells in (10, 20)
        ]
        for way in manufactured_causes.WAYS
    }
    order = {way: np.log2(coarse / fine)[2] for way, (coarse, fine) in rows.items()}
    stress = {way: fine[2] for way, (_, fine) in rows.items()}
    assert order["linear stress"] > 1.85
    assert stress["linear stress"] < 0.9 * stress["as it is"]
    assert stress["as it is"] < 0.75 * stress["double-mapped mass"]
