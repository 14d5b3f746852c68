"""What goes wrong is named, by step, time and place, and costs no more than the step in which it
happens."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import dense
import inside
import numpy as np
import pytest
from test_ranks import environment

import mpm_fenicsx as mpm

SOIL = dense.SOIL
CLAY = mpm.VonMises(SOIL, peak=10e3, residual=10e3, softening=0.0)
BEARS = 2 * 10e3  # Pa: pressure that a block of it bears in plane strain on a smooth base, 2c
KINDS = pytest.mark.parametrize("kind", [mpm.DM_GC, mpm.GIMP, None], ids=["DM-GC", "GIMP", "FE"])


def squeezed(kind, law=CLAY, stepping=None, most=3 * BEARS, solver=None):
    """A unit block on a smooth base, pushed from above with up to ``most`` (Pa) at time 1."""
    cells = 2 if kind is None else 3
    grid = mpm.Grid.box((0.0, 0.0), (0.5 * cells,) * 2, (cells, cells))
    terms = [mpm.Fixed(grid.facets("bottom"), "y"), mpm.Fixed(grid.facets("left"), "x")]
    stepping = stepping or mpm.QuasiStatic(4)
    if kind is None:
        return mpm.FiniteElements(
            grid,
            law,
            stepping,
            [*terms, mpm.Traction(grid.facets("top"), lambda t: (0.0, -most * t))],
            solver=solver,
            b_bar=False,  # with it the matrix may be singular where Newton fails
        )
    body = mpm.MaterialPoints.fill(grid, law, 4, lambda x: (x < 1.0).all(axis=0))
    return mpm.Simulation(
        grid,
        body,
        stepping,
        [*terms, mpm.Traction(body.surface("top"), lambda t: (0.0, -most * t))],
        kind,
        solver,
    )


def copied(run):
    """The state, less what the next step begins with: the cells of the points and the grid's
    motion."""
    derived = ("motion/u",) if isinstance(run, mpm.FiniteElements) else ("cell", "motion/")
    return {
        name: value.copy()
        for name, value in run.state().items()
        if not any(part in name for part in derived)
    }


def unchanged(run, before):
    now = copied(run)
    return sorted(now) == sorted(before) and all(
        np.array_equal(now[name], before[name]) for name in before
    )


# -- a step that fails -----------------------------------------------------------------------------


@KINDS
def test_a_step_that_fails_in_its_second_half_leaves_the_state_of_its_start(kind):
    """A block of perfect plasticity bears 2c: of the step from 3/4 to 3/2 of that only the first
    quarter is solved.  Where it fails K is all but singular, and round-off decides who says so."""
    run = squeezed(kind)
    energy = run.record(mpm.Energy())
    run.step()
    before, sums, solved, carry = copied(run), energy.sums.copy(), [], run.carry
    run.carry = lambda: (solved.append(1), carry())
    message = (
        r"step 2, t = 0\.5: (Newton does not converge, relative residuals .*|linear solver stopped "
        r"with PETSc reason -\d+ after \d+ iterations); largest residual "
        r".* N at the node "
        r"x=\[.*\]; from t = 0\.\d+ to 0\.\d+, the step halved 3 times$"
    )
    with pytest.raises(mpm.RunError, match=message):
        run.step()
    assert len(solved) > 0 and unchanged(run, before) and np.array_equal(energy.sums, sums)
    assert run.steps == 1 and energy.times.tolist() == [0.0, 0.25]


@pytest.mark.parametrize("kind", [mpm.DM_GC, None], ids=["points", "FE"])
def test_a_step_that_is_not_cut_copies_nothing(kind, monkeypatch):
    run = squeezed(kind, most=0.5 * BEARS)
    monkeypatch.setattr(run, "state", lambda: pytest.fail("the state is asked for"))
    run.until(1.0)


def test_the_largest_residual_is_where_the_force_is():
    """One node alone is loaded beyond what it bears."""
    run = squeezed(None, most=0.0)
    x = run.grid.space.tabulate_dof_coordinates()[:, :2]
    node = int(np.argmin(np.linalg.norm(x - (0.5, 1.0), axis=1)))
    said = inside.largest_residual(run, node, (3.0, -4.0))
    assert said == "largest residual 5 N at the node x=[0.5 1. ]"
    said = inside.largest_residual(run, node, (3.0, np.nan))
    assert said == "residual that is not a number at the node x=[0.5 1. ]"


def crushed(stepping):
    """Two bodies side by side, the second of which is turned inside out by a load from t = 0.25
    on."""
    grid = mpm.Grid.box((0, 0), (1, 1), (4, 4))
    bodies = [
        mpm.MaterialPoints.fill(grid, SOIL, 4, lambda x, low=low: (x[0] > low) & (x[0] < low + 0.5))
        for low in (0.0, 0.5)
    ]
    walls = [mpm.Fixed(grid.facets("bottom"), "y"), mpm.Fixed(grid.facets("left", "right"), "x")]
    load = mpm.Traction(bodies[1].surface("top"), lambda t: (0.0, -1e9 * (t > 0.25)))
    return mpm.Simulation(grid, bodies, stepping, [*walls, load])


def test_a_point_that_turns_inside_out_is_named_and_no_body_has_moved():
    run = crushed(mpm.QuasiStatic(10))
    probe = run.record(mpm.Probe("stress", (0.3, 0.3)))
    run.until(0.2)
    before = copied(run)
    message = (
        r"DM-GC, step 3, t = 0\.3: body 1, material point \d+ at x=\[0\..*\] turns inside out: "
        r"det F = -.* in "
        r"the step$"
    )
    for _ in range(2):  # tried again it fails again
        with pytest.raises(mpm.RunError, match=message):
            run.step()
        assert unchanged(run, before) and run.steps == 2
    assert len(probe.times) == 3


def test_a_support_domain_that_turns_inside_out_is_named_as_such():
    body = mpm.MaterialPoints.fill(mpm.Grid.box((0, 0), (1, 1), (1, 1)), SOIL, 4)
    gradient = np.zeros((4, 2, 2))
    stretch = np.ones((4, 2))
    stretch[2, 1] = -0.5
    with pytest.raises(
        ValueError,
        match=r"point 2 at .* has a support domain that turns inside out: it stretches by "
        r"\[ 1\.  -0\.5\]",
    ):
        body.stretches(gradient, stretch)


def test_a_point_that_was_lost_can_be_put_back():
    run = crushed(mpm.Newmark(1e-4))
    run.step()
    before = copied(run)
    run.bodies[1].x[5] = (3.0, 0.3)
    with pytest.raises(
        mpm.RunError, match=r"step 2, .*: body 1, material point 5 at x=\[3\.  0\.3\] lies outside"
    ):
        run.step()
    run.bodies[1].x[5] = before["bodies/1/x"][5]
    run.step()
    again = crushed(mpm.Newmark(1e-4))
    again.until(2e-4)
    assert unchanged(run, copied(again))


def test_a_cell_that_turns_inside_out_is_named():
    """One linear solve a step of 1e9 Pa on 20 MPa: the elements end inside out, and the state stays
    as it was."""
    one_solve = mpm.Solver(newton=mpm.Newton(tolerance=None))
    run = squeezed(
        None, mpm.Hencky(20e6, 0.25, 1500.0), mpm.QuasiStatic(1), most=1e9, solver=one_solve
    )
    before = copied(run)
    with pytest.raises(
        mpm.RunError,
        match=r"FE, step 1, t = 1: cell \d with its centre at x=\[0\..*\] turns inside out: "
        r"det F = -\d",
    ):
        run.step()
    assert unchanged(run, before)


# -- loads -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", [SOIL, CLAY], ids=["elastic", "von Mises"])
@pytest.mark.parametrize("kind", [mpm.DM_GC, None], ids=["points", "FE"])
@pytest.mark.parametrize("placed", [False, True])
def test_a_load_that_is_no_number_is_named(kind, law, placed):
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.5), (2, 3))
    body = mpm.MaterialPoints.fill(grid, law, 4, lambda x: x[1] < 1.0)
    bad = (
        (lambda t, x: np.where(x[:, :1] > 0.6, np.log(0.25 - t), 0.0) * np.ones(2))
        if placed
        else (lambda t: (0.0, np.log(0.25 - t)))
    )
    on = grid.facets("top") if kind is None else body.surface("top")
    for term, name in (
        (mpm.Gravity(bad), "g of Gravity"),
        (mpm.Traction(on, bad), "value of Traction"),
    ):
        terms, stepping = [mpm.Fixed(grid.facets("bottom")), term], mpm.Newmark(0.1)
        run = (
            mpm.FiniteElements(grid, law, stepping, terms)
            if kind is None
            else mpm.Simulation(grid, body, stepping, terms)
        )
        where = r"\[nan nan\] at t = 0\.3, x=\[.*\]" if placed else r"\[ 0\. nan\] at t = 0\.3"
        with (
            pytest.raises(
                mpm.RunError, match=rf"step 3, t = 0\.3: {name} must be finite, got {where}$"
            ),
            np.errstate(invalid="ignore"),
        ):
            run.until(1.0)
        assert run.steps == 2
        assert all(
            np.isfinite(value).all() for value in run.state().values() if value.dtype.kind == "f"
        )


# -- output ----------------------------------------------------------------------------------------


def full(file: Path):
    """The next attempt to write ``file`` meets a device without space (Linux)."""
    file.with_name(file.name + ".part").symlink_to("/dev/full")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
@pytest.mark.parametrize("kind", [mpm.DM_GC, None], ids=["points", "FE"])
def test_a_full_disk_costs_a_file_and_nothing_else(kind, tmp_path):
    """Step 2 cannot write: all else has its data, the old files stay, and the run goes on as if
    nothing had been."""
    run, calm = (squeezed(kind, SOIL, mpm.Newmark(1e-3)) for _ in range(2))
    shots = run.record(mpm.Snapshots(tmp_path / "block"))
    keep = run.record(mpm.Checkpoint(tmp_path / "state.npz"))
    probe, energy = run.record(mpm.Probe("stress", (0.5, 0.5))), run.record(mpm.Energy())
    run.step()
    kept = keep.path.read_bytes()
    full(tmp_path / "block_grid_000002.vtu")
    full(keep.path)
    with pytest.raises(
        mpm.RunError,
        match=r"step 2, t = 0\.002: snapshot not written: No space left on device: .*block",
    ) as caught:
        run.until(5e-3)
    assert isinstance(caught.value, OSError) and caught.value.errno == errno.ENOSPC
    assert caught.value.filename == str(shots.path)
    assert (
        run.steps == 2
        and len(probe.times) == len(energy.times) == 3
        and keep.path.read_bytes() == kept
    )
    full(keep.path)
    with pytest.raises(
        mpm.RunError, match=r"step 3, t = 0\.003: checkpoint not written: No space .*state\.npz"
    ):
        run.until(5e-3)
    run.until(4e-3)  # there is space again
    run.recorders.remove(shots)
    run.until(5e-3)
    calm.until(5e-3)
    assert unchanged(calm, copied(run)) and len(probe.times) == len(energy.times) == 6
    assert not list(tmp_path.glob("*.part"))
    again = squeezed(kind, SOIL, mpm.Newmark(1e-3))
    again.restart(keep.path)
    assert again.steps == 5 and unchanged(again, copied(run))


def test_a_file_size_limit_leaves_the_checkpoint_before(tmp_path):
    resource = pytest.importorskip("resource")
    run = squeezed(mpm.DM_GC, SOIL, mpm.Newmark(1e-3))
    keep = run.record(mpm.Checkpoint(tmp_path / "state.npz"))
    run.step()
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limit[1]))
    try:
        with pytest.raises(
            mpm.RunError, match=r"step 2, t = 0\.002: checkpoint not written: File too large"
        ):
            run.step()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert [path.name for path in tmp_path.iterdir()] == ["state.npz"]
    run.restart(keep.path)
    assert run.steps == 1


def killed(folder):
    """What a process does that is killed while it writes its third checkpoint."""
    run, sync = squeezed(mpm.DM_GC, SOIL, mpm.Newmark(1e-3)), os.fsync
    run.record(mpm.Checkpoint(folder / "state.npz"))
    os.fsync = lambda file: os.kill(os.getpid(), signal.SIGKILL) if run.steps == 3 else sync(file)
    run.until(1.0)


def test_a_process_that_is_killed_while_it_writes_leaves_the_checkpoint_before(tmp_path):
    done = subprocess.run(
        [sys.executable, __file__, str(tmp_path)],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == -signal.SIGKILL, done.stderr[-2000:]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["state.npz", "state.npz.part"]
    run, whole = (squeezed(mpm.DM_GC, SOIL, mpm.Newmark(1e-3)) for _ in range(2))
    run.restart(tmp_path / "state.npz")
    run.record(mpm.Checkpoint(tmp_path / "state.npz"))
    assert run.steps == 2
    for one in (run, whole):
        one.until(4e-3)
    assert unchanged(whole, copied(run)) and [path.name for path in tmp_path.iterdir()] == [
        "state.npz"
    ]


def test_recorders_without_an_errno_are_named_too():
    run = squeezed(None, SOIL, mpm.Newmark(1e-3))

    class Broken:
        def attach(self, run):
            pass

        def __call__(self, run):
            raise OSError("the tape is torn")

    run.record(Broken())
    probe = run.record(mpm.Probe("stress", (0.5, 0.5)))
    with pytest.raises(mpm.RunError, match=r"^FE, step 1, t = 0\.001: the tape is torn$"):
        run.step()
    assert len(probe.times) == 2


if __name__ == "__main__":
    killed(Path(sys.argv[1]))
