"""Points that leave the grid stop the run in a sentence, or are taken out with nothing lost."""

import json
from pathlib import Path

import numpy as np
import pytest
from test_ranks import on_ranks

import mpm_fenicsx as mpm

SOIL = mpm.LinearElastic(young=20e6, poisson=0.3, density=1800.0)
WEAK = mpm.VonMises(SOIL, peak=5e3, residual=5e3, softening=0.0)
FINITE = mpm.Hencky(20e6, 0.3, 1800.0)
SPEED = 2.0  # m/s


def flying(mapping=mpm.DM_GC, soil=SOIL, dim=2, on_exit=mpm.REMOVE, terms=None, dt=5e-3):
    """A block of 1 m that flies to the right, 1 m from the grid's end, at t = 0.5 s."""
    upper, cells = (4.0, 2.0, 1.0)[:dim], (8, 4, 2)[:dim]
    grid = mpm.Grid.box([0.0] * dim, upper, cells)
    body = mpm.MaterialPoints.fill(
        grid, soil, 2**dim, lambda x: (x[0] > 2) & (x[0] < 3) & (x[1] > 0.5) & (x[1] < 1.5)
    )
    body.velocity = np.tile([SPEED, 0.0, 0.0][:dim], (len(body), 1))
    more = terms(grid, body) if terms else []
    return mpm.Simulation(grid, body, mpm.Newmark(dt), more, mapping, on_exit=on_exit)


@pytest.mark.parametrize("mapping", [mpm.DM_GC, mpm.GIMP, mpm.MPM], ids=str)
@pytest.mark.parametrize("dim", [2, 3])
def test_a_block_flies_out_column_by_column_and_energy_balances(mapping, dim):
    run = flying(mapping, dim=dim)
    energy, inside = mpm.Energy(), mpm.Probe("velocity", (2.1, 1.0, 0.5)[:dim])
    run.record(energy)
    run.record(inside)
    whole, mass = len(run.bodies[0]), run.bodies[0].mass.sum()
    run.until(0.8)  # two columns of four are out: they began at 2.625 and 2.875 m
    body = run.bodies[0]
    assert len(body) == run.removed.points == whole // 2
    assert run.removed.mass == pytest.approx(0.5 * mass, rel=1e-12)
    assert run.removed.energy == pytest.approx(0.5 * 0.5 * mass * SPEED**2, rel=1e-9)
    np.testing.assert_allclose(body.velocity[:, 0], SPEED, rtol=1e-9)
    assert energy.names[-1] == "removed" and energy["removed"][-1] == run.removed.energy
    assert np.abs(energy.lost).max() < 1e-9 * energy["kinetic"][0]
    np.testing.assert_allclose(inside.values[-1][:2], [SPEED, 0.0], atol=1e-9)
    assert f"taken out: {whole // 2} so far" in str(run)
    with pytest.raises(mpm.RunError, match="all material points of body 0 have left the grid"):
        run.until(2.0)


def test_a_probe_of_points_that_are_gone_says_so():
    run = flying()
    first = run.record(mpm.Probe("stress", (2.9, 1.0)))
    run.until(0.8)
    gone = np.isnan(first.values).any(axis=1)
    assert not gone[: np.searchsorted(first.times, 0.49)].any() and gone[-1]


@pytest.mark.parametrize("soil", [SOIL, WEAK, FINITE], ids=lambda s: type(s).__name__)
def test_strain_and_plastic_energy_go_with_the_points(soil):
    """Nothing happens but that a point is gone: the sum is what it was."""
    run = flying(soil=soil)
    body = run.bodies[0]
    rng = np.random.default_rng(0)
    body.stress[:] = 1e3 * rng.normal(size=body.stress.shape)
    if body.history is not None:
        body.history[:] = rng.uniform(0.0, 0.1, body.history.shape)
    before, mass = sum(run.energy().values()), body.mass.sum()
    body.x[[2, 9]] = [[4.01, 1.0], [5.0, -3.0]]
    kept = np.delete(body.stress, [2, 9], axis=0)
    run.filled_cells()
    assert sum(run.energy().values()) == pytest.approx(before, rel=1e-12)
    assert body.mass.sum() + run.removed.mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_array_equal(body.stress, kept)
    assert run.removed.points == 2


def test_without_it_the_run_stops_and_says_where_and_when():
    run = flying(on_exit=mpm.OnExit.STOP)
    words = (
        r"DM-GC, step 114, t = 0.57: material point \d+ at x=\[4.00\d+ +[\d.]+\] lies outside the "
        "grid: give it more cells there, or on_exit=REMOVE, with which such points are taken out"
    )
    with pytest.raises(mpm.RunError, match=words):
        run.until(1.0)
    assert run.removed == (0, 0.0, 0.0)
    assert "removed" not in run.energy()


def test_a_run_with_points_gone_is_checkpointed_and_halved_steps_bring_them_back(tmp_path):
    run = flying(soil=WEAK)
    energy, still = run.record(mpm.Energy()), run.record(mpm.Probe("velocity", (2.1, 1.0)))
    run.record(mpm.Snapshots(tmp_path / "scene", every=40))
    run.record(mpm.Checkpoint(tmp_path / "run", every=130))
    run.until(0.75)
    assert 0 < run.removed.points
    again = flying(soil=WEAK)
    recorded = again.record(mpm.Energy()), again.record(mpm.Probe("velocity", (2.1, 1.0)))
    again.restart(tmp_path / "run")
    assert again.steps == 130 and again.removed.points > 0
    again.until(0.75)
    np.testing.assert_array_equal(again.bodies[0].x, run.bodies[0].x)
    np.testing.assert_array_equal(recorded[0].values, energy.values)
    np.testing.assert_array_equal(recorded[1].values, still.values)
    assert again.removed == run.removed
    with pytest.raises(ValueError, match="points of"):
        flying(soil=WEAK, on_exit=mpm.OnExit.STOP).restart(tmp_path / "run")
    body, before = run.bodies[0], run.removed
    x = body.x.copy()
    with pytest.raises(ZeroDivisionError), run.all_or_nothing(True):
        body.x[0, 0] = 4.5
        run.filled_cells()
        assert len(run.bodies[0]) == len(x) - 1
        raise ZeroDivisionError
    assert len(body) == len(x) and run.removed == before
    np.testing.assert_array_equal(body.x[1:], x[1:])


def test_surface_points_that_would_stay_behind_are_named():
    def pressed(grid, body):
        return [mpm.Traction(body.surface("left"), (0.0, 0.0))]

    run = flying(terms=pressed)
    run.until(0.75)  # the other columns have left
    with pytest.raises(
        mpm.RunError, match=r"material point at x=\[4.0\d+ .* leaves the grid together with .*faces"
    ):
        run.until(1.0)


def test_what_cannot_be_taken_out_is_refused():
    run = flying()
    run.bodies[0].x[3, 0] = np.nan
    with pytest.raises(mpm.RunError, match=r"point lies at x=\[ *nan .* which is no place"):
        run.step()
    with pytest.raises(ValueError, match=r"on_exit must be OnExit.STOP or OnExit.REMOVE, got 'r"):
        flying(on_exit="remove")
    one, other = flying(), flying(on_exit=mpm.OnExit.STOP)
    grid = one.grid
    pairs = [(run, run.bodies[0].surface("left")) for run in (one, other)]
    with pytest.raises(ValueError, match="on_exit=REMOVE is not for runs of a Contact"):
        mpm.Contact(*pairs)
    assert grid is one.grid


RANKS = """
import json, sys
import numpy as np
from mpi4py import MPI
import mpm_fenicsx as mpm
sys.path.insert(0, sys.argv[1])
import test_leaving
run = test_leaving.flying(dt=0.02)
energy = run.record(mpm.Energy())
probe = run.record(mpm.Probe("velocity", (2.9, 1.0)))
run.record(mpm.Checkpoint("two", every=32))
run.until(0.8)
comm = MPI.COMM_WORLD
x = np.concatenate(comm.allgather(run.bodies[0].x))
again = test_leaving.flying(dt=0.02)
again.restart("two")
again.until(0.8)
if comm.rank == 0:
    x = x[np.lexsort(x.round(6).T)].tolist()
    same = again.removed == run.removed
    print(json.dumps([x, run.removed, float(np.abs(energy.lost).max()), same,
                      bool(np.isnan(probe.values[-1]).all())]))
"""


def test_on_two_ranks_the_same_points_leave(tmp_path):
    script = tmp_path / "two.py"
    script.write_text(RANKS)
    found = on_ranks(2, script, Path(__file__).parent, cwd=str(tmp_path))
    x, removed, lost, same, gone = json.loads(found)
    run = flying(dt=0.02)
    run.until(0.8)
    mine = run.bodies[0].x
    np.testing.assert_allclose(np.array(x), mine[np.lexsort(mine.round(6).T)], rtol=1e-9)
    np.testing.assert_allclose(removed, run.removed, rtol=1e-9)
    assert lost < 1e-6 and same and gone
    again = flying(dt=0.02)
    again.restart(tmp_path / "two")
    again.until(0.8)
    np.testing.assert_allclose(again.removed, removed, rtol=1e-9)
