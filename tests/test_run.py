"""Time, recorders, and runs that cannot go on."""

import warnings

import dense
import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx import Traction as Load


class Notes:
    """A recorder."""

    def __init__(self):
        self.attached, self.times = [], []

    def attach(self, run):
        self.attached.append(run)
        self(run)

    def __call__(self, run):
        self.times.append(run.time)


def make(kind, stepping, terms=()):
    grid = dense.uneven(2)
    terms = [mpm.Fixed(grid.facets("bottom")), *terms]
    if kind == "FE":
        return mpm.FiniteElements(grid, dense.SOIL, stepping, terms)
    return mpm.Simulation(grid, mpm.MaterialPoints.fill(grid, dense.SOIL, 4), stepping, terms)


@pytest.mark.parametrize("kind", ["FE", "points"])
@pytest.mark.parametrize(
    "stepping", [mpm.Newmark(0.1), mpm.QuasiStatic(10)], ids=["dynamic", "static"]
)
def test_recorders_see_the_start_and_every_step(kind, stepping):
    run, notes, done = make(kind, stepping), Notes(), []
    assert run.record(notes) is notes
    assert notes.attached == [run]
    run.until(0.3, progress=done.append)
    assert done == [1, 2, 3]
    assert notes.times == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert run.next_time == pytest.approx(0.4)
    run.until(0.3)
    with pytest.raises(ValueError, match=r"t must not be past, .* has come to t = 0\.3, got 0\.1"):
        run.until(0.1)
    assert run.steps == 3


def test_time_is_counted_and_does_not_drift():
    run = make("FE", mpm.Newmark(0.1))
    run.until(1.2)
    assert (run.steps, run.time) == (12, 12 * 0.1)


def test_a_point_that_leaves_the_grid_stops_the_run_and_keeps_the_record():
    grid = mpm.Grid.box((0, 0), (1, 1), (4, 4))
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4, inside=lambda x: x[0] > 0.5)
    body.velocity = np.tile([1.0, 0.0], (len(body), 1))
    run = mpm.Simulation(grid, body, mpm.Newmark(0.05), [])
    notes = run.record(Notes())
    message = r"DM-GC, step 3, t = 0\.15: material point \d+ at x=\[1\.0375 .*outside the grid"
    with pytest.raises(mpm.RunError, match=message):
        run.until(1.0)
    assert notes.times == pytest.approx([0.0, 0.05, 0.1])
    assert run.steps == 2
    assert np.isfinite(body.x).all()


def test_a_point_that_turns_inside_out_stops_the_run_and_keeps_the_record():
    grid = mpm.Grid.box((0, 0), (1, 1), (4, 4))
    body = mpm.MaterialPoints.fill(grid, dense.SOIL, 4)
    walls = [mpm.Fixed(grid.facets("bottom"), "y"), mpm.Fixed(grid.facets("left", "right"), "x")]
    crush = Load(grid.facets("top"), lambda s: (0.0, -1e9 * (s > 0.25)))
    run = mpm.Simulation(grid, body, mpm.QuasiStatic(10), [*walls, crush])
    notes = run.record(Notes())
    with pytest.raises(
        mpm.RunError,
        match=r"step 3, t = 0\.3: material point \d+ at x=.* turns inside out: det F = -",
    ):
        run.until(1.0)
    assert notes.times == pytest.approx([0.0, 0.1, 0.2])


@pytest.mark.parametrize("kind", ["FE", "points"])
def test_a_load_that_turns_nan_stops_the_run(kind):
    run = make(kind, mpm.Newmark(0.1), [mpm.Gravity(lambda t: (0.0, np.nan if t > 0.25 else 0.0))])
    notes = run.record(Notes())
    with pytest.raises(mpm.RunError, match=r"step 3, t = 0\.3: "):
        run.until(1.0)
    assert notes.times == pytest.approx([0.0, 0.1, 0.2])


def test_an_error_inside_a_load_names_step_and_time():
    def load(t):
        if t > 0.15:
            raise ValueError("the table ends at 0.15 s")
        return 0.0, 0.0

    run = make("points", mpm.Newmark(0.1), [mpm.Gravity(load)])
    words = r"step 2, t = 0\.2: g of Gravity raises ValueError at t = 0\.2: the table ends"
    with pytest.raises(mpm.RunError, match=words) as caught:
        run.until(1.0)
    assert isinstance(caught.value.__cause__, ValueError)


def test_a_recorder_that_fails_does_not_pass_for_the_step():
    run = make("FE", mpm.Newmark(0.1))

    class Full(Notes):
        def __call__(self, run):
            if run.steps == 2:
                raise OSError("disk full")

    run.record(Full())
    with pytest.raises(OSError, match="disk full"):
        run.until(1.0)
    assert run.steps == 2


@pytest.mark.parametrize("t", [np.nan, np.inf, "soon"])
def test_until_needs_a_time(t):
    with pytest.raises(ValueError, match=r"^t must be"):
        make("FE", mpm.Newmark(0.1)).until(t)


@pytest.mark.parametrize(("dt", "t", "stop"), [(0.3, 1.0, 0.9), (0.1, 0.46, 0.5), (0.3, 0.1, 0.0)])
def test_until_says_where_it_stops_if_it_is_no_whole_number_of_steps(dt, t, stop):
    run = make("FE", mpm.Newmark(dt))
    with pytest.warns(
        UserWarning,
        match=rf"until\({t}\) stops at t = {stop:.6g}: .*no whole number of steps of {dt}",
    ):
        run.until(t)
    assert run.time == pytest.approx(stop)


def test_until_takes_rounded_times_for_whole_numbers_of_steps():
    run = make("FE", mpm.Newmark(0.1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for t in (0.1 + 0.2, 0.7 - 1e-12, 8 * 0.1 + 1e-13, 0.8):
            run.until(t)
    assert run.steps == 8
