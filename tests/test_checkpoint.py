"""A run that goes on from a checkpoint in another process is the run that was never stopped, to the
last bit.

As a script: ``python test_checkpoint.py folder`` goes on with the checkpoints of a folder, one a
scene; ``mpiexec -n 2 python test_checkpoint.py folder ranks`` writes and reads them on two ranks.
"""

import functools
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import dense
import numpy as np
import pytest
import test_ranks
from test_ranks import environment

import mpm_fenicsx as mpm
from mpm_fenicsx.runs.identity import described

STEPS = 6
SOFT = dense.SOFT
CLAY = mpm.VonMises(SOFT, peak=3e3, residual=1e3, softening=30e3)
STRETCHED = mpm.VonMises(
    mpm.Hencky(3e6, 0.3, 1800.0), peak=3e3, residual=1e3, softening=30e3, length=0.5
)


def place(dim=2, room=1):
    """A grid of half metre cells, and how to fill a unit block of it with jittered points, ``room``
    cells around."""
    low, high = np.array((-0.5, -0.5, 0.0)[:dim]) * room, (2.0, 1.5, 1.0)[:dim]
    grid = mpm.Grid.box(low, high, (4 + room, 3 + room, 2)[:dim])
    return grid, lambda law: mpm.MaterialPoints.fill(
        grid, law, 2**dim, lambda x: (abs(x[:2] - 0.5) < 0.5).all(axis=0), jitter=0.3
    )


def push(t, x):
    """Pressure that grows, uneven in x."""
    value = np.zeros_like(x)
    value[:, 1] = -6e3 * (1.0 + 20.0 * t) * (0.5 + x[:, 0])
    return value


def points(law, mapping=mpm.DM_GC, dim=2, stepping=None, solver=None):
    """A body that drifts across cells on springs and dashpots that move with it, pushed from
    above."""
    grid, fill = place(dim)
    body = fill(law)
    body.velocity = np.tile((6.0, -0.3, 0.0)[:dim], (len(body), 1))
    terms = [
        mpm.Gravity((0.0,) * (dim - 1) + (-9.81,)),
        mpm.Traction(body.surface("top"), push),
        mpm.ViscoelasticBoundary(body.surface("bottom"), SOFT, 3.0),
        mpm.Traction(body.surface("left"), (1e3,) * dim),
    ]
    return mpm.Simulation(grid, body, stepping or mpm.Newmark(5e-3), terms, mapping, solver)


def confined(law, mapping, stepping):
    """A body between smooth walls, pushed from above."""
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.5), (2, 3))
    body = mpm.MaterialPoints.fill(grid, law, 4, lambda x: x[1] < 1.0, jitter=0.3)
    terms = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom")),
        mpm.Gravity((0.0, -9.81)),
        mpm.Traction(body.surface("top"), push),
    ]
    return mpm.Simulation(grid, body, stepping, terms, mapping)


def two_bodies():
    """A stiff body that yields beside a soft one that does not."""
    grid, _ = place(room=0)
    left, right = (
        mpm.MaterialPoints.fill(
            grid,
            law,
            4,
            lambda x, low=low: (abs(x[0] - low - 0.25) < 0.25) & (x[1] < 1.0),
            jitter=0.2,
        )
        for law, low in ((CLAY, 0.0), (SOFT, 0.5))
    )
    return mpm.Simulation(
        grid,
        [left, right],
        mpm.Newmark(5e-3),
        [
            mpm.Fixed(grid.facets("bottom")),
            mpm.Traction(right.surface("top"), push),
            mpm.Traction(left.surface("top"), push),
        ],
        mpm.GIMP,
    )


def elements(law, stepping=None, **keywords):
    """Finite elements on springs and dashpots, pushed from above."""
    grid, stepping = place(room=0)[0], stepping or mpm.Newmark(5e-3)
    base = (
        [mpm.ViscoelasticBoundary(grid.facets("bottom"), SOFT, 3.0)]
        if stepping.dynamic
        else [mpm.Fixed(grid.facets("bottom"))]
    )
    return mpm.FiniteElements(
        grid,
        law,
        stepping,
        [
            *base,
            mpm.Gravity((0.0, -9.81)),
            mpm.Traction(grid.facets("top"), push),
            mpm.Fixed(grid.facets("left"), "x"),
        ],
        **keywords,
    )


SCENES = {
    "elastic": lambda: points(SOFT),
    "elastic 3D": lambda: points(SOFT, dim=3),
    "elastic MPM": lambda: confined(SOFT, mpm.MPM, mpm.Newmark(5e-3)),
    "static": lambda: confined(SOFT, mpm.DM_GC, mpm.QuasiStatic(500)),
    "B-bar": lambda: points(CLAY, replace(mpm.DM_GC, b_bar=True)),
    "von Mises": lambda: points(CLAY),
    "von Mises GIMP": lambda: points(CLAY, mpm.GIMP),
    "von Mises, steps cut": lambda: points(
        CLAY, solver=mpm.Solver(newton=mpm.Newton(tolerance=3e-4, iterations=2, halvings=0))
    ),
    "Hencky": lambda: points(mpm.Hencky(3e6, 0.3, 1800.0)),
    "finite von Mises": lambda: points(STRETCHED),
    "finite von Mises MPM": lambda: confined(STRETCHED, mpm.MPM, mpm.Newmark(1e-2)),
    "generalised α": lambda: points(
        STRETCHED, stepping=mpm.GeneralizedAlpha(5e-3, spectral_radius=0.5)
    ),
    "two bodies": two_bodies,
    "FE": lambda: elements(SOFT),
    "FE von Mises": lambda: elements(CLAY),
    # without B-bar cells lock, and bear more than clay can
    "FE von Mises static": lambda: elements(CLAY, mpm.QuasiStatic(500), b_bar=False),
    "FE Hencky": lambda: elements(STRETCHED),
    "FE generalised α": lambda: elements(
        STRETCHED, mpm.GeneralizedAlpha(5e-3, spectral_radius=0.5, start=0.5)
    ),
}


def recorded(run):
    """The run with recorders of every kind; dynamics have a velocity."""
    dim = run.grid.dim
    for field in ("displacement", "stress", *(["velocity"] if run.stepping.dynamic else [])):
        run.record(mpm.Probe(field, (0.4, 0.6, 0.3)[:dim]))
    run.record(mpm.Energy())
    return run


def everything(run, path):
    """All arrays of the run and its recorders, as a checkpoint has them."""
    mpm.Checkpoint(path)(run)
    with np.load(path) as file:
        return dict(file)


def same(found, expected):
    """Names and bits."""
    assert sorted(found) == sorted(expected)
    for name, value in expected.items():
        assert value.dtype == found[name].dtype and np.array_equal(value, found[name]), name


@pytest.fixture(scope="module")
def half(tmp_path_factory):
    """The folder of checkpoints at half time, and what a process that never stopped has at the
    end."""
    folder, ends, halfway = tmp_path_factory.mktemp("checkpoints"), {}, {}
    for name, scene in SCENES.items():
        run = recorded(scene())
        keep = run.record(mpm.Checkpoint(folder / f"{name}.npz", every=STEPS))
        assert not keep.path.exists()
        for _ in range(STEPS):
            run.step()
        run.recorders.remove(keep)
        halfway[name] = everything(run, folder / "now.npz")
        for _ in range(STEPS):
            run.step()
        ends[name] = everything(run, folder / "now.npz")
    return folder, halfway, ends


@pytest.fixture(scope="module")
def resumed(half):
    """Folder of what another process, that starts from the checkpoints, has at the end."""
    done = subprocess.run(
        [sys.executable, __file__, str(half[0])],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    return half[0]


@pytest.mark.parametrize("name", SCENES)
def test_another_process_goes_on_bit_for_bit(name, half, resumed):
    _, halfway, ends = half
    with np.load(resumed / f"{name} end.npz") as file:
        same(dict(file), ends[name])
    with np.load(resumed / f"{name}.npz") as file:
        same(dict(file), halfway[name])
    times = ends[name]["0/recorders/Energy/times"]
    assert len(times) == 2 * STEPS + 1 and (np.diff(times) > 0).all()
    moved = next(key for key in ("0/run/bodies/0/x", "0/run/displacement") if key in ends[name])
    assert not np.array_equal(halfway[name][moved], ends[name][moved])


def test_the_scenes_do_what_they_are_there_for(half):
    """Points change cells, laws yield and soften in both halves, steps are cut, springs and
    surfaces are there."""
    _, halfway, ends = half
    for name, end in ends.items():
        if "Mises" in name:
            κ = next(v for k, v in end.items() if k.endswith("history"))
            before = next(v for k, v in halfway[name].items() if k.endswith("history"))
            assert before.max() > 1e-4 and κ.max() > before.max(), name
    assert not np.array_equal(
        halfway["elastic"]["0/run/bodies/0/cell"], ends["elastic"]["0/run/bodies/0/cell"]
    )
    assert np.abs(ends["elastic"]["0/run/surfaces/1/displacement"]).max() > 0.1
    run = SCENES["von Mises, steps cut"]()
    cuts, advance = [], run.advance
    run.advance = lambda start, end, cut=0: (cuts.append(cut), advance(start, end, cut))[1]
    for _ in range(STEPS):
        run.step()
    assert max(cuts) > 0


@pytest.mark.parametrize("name", ["elastic", "FE von Mises"])
def test_a_run_goes_back_in_its_own_process(name, half, tmp_path):
    """Restarted where it stands, after more steps, a run repeats them; its record is as if it had
    not been further."""
    folder, _, ends = half
    run = recorded(SCENES[name]())
    for _ in range(STEPS + 3):
        run.step()
    for _ in range(2):
        run.restart(folder / f"{name}.npz")
        assert run.steps == STEPS and len(run.recorders[0].times) == STEPS + 1
        for _ in range(STEPS):
            run.step()
        same(everything(run, tmp_path / "now.npz"), ends[name])


def test_without_a_part_of_the_state_the_end_is_another(half, tmp_path):
    """The comparison sees what is missing: each of these, left as it is built, gives other bits."""
    folder, _, ends = half
    for name, part in (
        ("elastic", "bodies/0/acceleration"),
        ("elastic", "surfaces/1/displacement"),
        ("elastic", "surfaces/0/normal"),
        ("two bodies", "bodies/0/history"),
        ("elastic", "bodies/0/half"),
        ("FE von Mises", "yielding/elastic"),
        ("FE", "motion/a"),
        ("FE", "surfaces/0/total"),
    ):
        run = recorded(SCENES[name]())
        built = run.state()[part].copy()
        run.restart(folder / f"{name}.npz")
        assert not np.array_equal(run.state()[part], built)
        run.state()[part][...] = built
        for _ in range(STEPS):
            run.step()
        with pytest.raises(AssertionError):
            same(everything(run, tmp_path / "now.npz"), ends[name])


def test_one_rank_removes_the_files_of_several(tmp_path):
    run, path = points(SOFT), tmp_path / "state.npz"
    others = [tmp_path / f"state.npz.{name}" for name in ("0123abcd.0", "0123abcd.1.part", "mine")]
    for file in others:
        file.write_text("before")
    mpm.Checkpoint(path)(run)
    assert path.exists() and [file.exists() for file in others] == [False, False, True]


def test_a_checkpoint_looks_last_and_in_its_turn(tmp_path):
    """Attached first, it still has what the others recorded in its step."""
    run = points(SOFT)
    keep = run.record(mpm.Checkpoint(tmp_path / "new" / "folder" / "state.npz", every=2))
    probe = run.record(mpm.Probe("velocity", (0.4, 0.6)))
    for _ in range(3):
        run.step()
    with np.load(keep.path) as file:
        assert (
            file["steps"] == 2
            and len(file["0/recorders/Probe of velocity at [0.4 0.6]/times"]) == 3
        )
    assert len(probe.times) == 4 and [p.name for p in keep.path.parent.iterdir()] == ["state.npz"]


def test_snapshots_list_what_was_written_before(tmp_path):
    run = points(SOFT)
    run.record(mpm.Snapshots(tmp_path / "block"))
    run.record(mpm.Checkpoint(tmp_path / "state.npz", every=2))
    for _ in range(3):
        run.step()
    again = points(SOFT)
    again.record(mpm.Snapshots(tmp_path / "block"))
    again.restart(tmp_path / "state.npz")
    again.step()
    listed = re.findall(r'file="(.*?)"', (tmp_path / "block_points.pvd").read_text())
    assert listed == [f"block_points_00000{n}.vtu" for n in range(4)]


# -- refusals --------------------------------------------------------------------------------------


def coarse():
    grid = mpm.Grid.box((0.0, 0.0), (2.0, 1.5), (2, 3))
    return mpm.Simulation(grid, mpm.MaterialPoints.fill(grid, SOFT, 4), mpm.Newmark(5e-3), [])


def other(**changed):
    """The scene "elastic" with something else."""
    grid, fill = place()
    law = changed.get("law", SOFT)
    body = (
        fill(law)
        if "inside" not in changed
        else mpm.MaterialPoints.fill(grid, law, 4, changed["inside"])
    )
    on = body.surface("top") if "side" not in changed else body.surface(*changed["side"])
    terms = [
        mpm.Gravity(changed.get("g", (0.0, -9.81))),
        mpm.Traction(on, changed.get("push", push)),
        mpm.ViscoelasticBoundary(
            body.surface("bottom"), changed.get("soil", SOFT), changed.get("radius", 3.0)
        ),
        mpm.Traction(body.surface("left"), changed.get("value", (1e3, 1e3))),
    ]
    return mpm.Simulation(
        grid,
        body,
        changed.get("stepping", mpm.Newmark(5e-3)),
        terms[: changed.get("terms", 4)],
        changed.get("mapping", mpm.DM_GC),
    )


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (coarse, "grid is 20 cells in 2D, 30 nodes.*here 6 cells in 2D, 12 nodes"),
        (lambda: elements(SOFT), "run is DM-GC in the checkpoint, and here FE"),
        (lambda: other(mapping=mpm.GIMP), "run is DM-GC in the checkpoint, and here GIMP"),
        (
            lambda: other(stepping=mpm.Newmark(4e-3)),
            r"stepping is Newmark\(dt=0.005,.* here Newmark\(dt=0.004,",
        ),
        (
            lambda: other(law=mpm.LinearElastic(4e6, 0.3, 1800.0)),
            "body 0 is 16 points of .*3000000.0.* here .*4000000.0",
        ),
        (lambda: other(inside=lambda x: x[1] < 1.0), "body 0 is 16 points .* here 60 points"),
        (
            lambda: other(terms=3),
            "terms is Gravity, Traction, ViscoelasticBoundary, Traction in the checkpoint, and "
            "here Gravity, Traction, ViscoelasticBoundary$",
        ),
        (
            lambda: other(g=(0.0, -9.8)),
            r"term 0, Gravity is Gravity\(g=\[0.0, -9.81\]\) in .* here Gravity\(g=\[0.0, -9.8\]\)",
        ),
        (
            lambda: other(g=lambda t: (0.0, -9.81)),
            r"term 0, Gravity is .* here Gravity\(g=<lambda>\)",
        ),
        (
            lambda: other(value=(1e3, 2e3)),
            r"term 3, Traction is Traction\(on=surface points, value=\[1000.0, 1000.0\]\)",
        ),
        (
            lambda: other(radius=4.0),
            r"term 2, ViscoelasticBoundary is .*radius=3.0\) in .*radius=4.0\)",
        ),
        (
            lambda: other(soil=mpm.LinearElastic(4e6, 0.3, 1800.0)),
            r"term 2, ViscoelasticBoundary is .*young=3000000.0.*young=4000000",
        ),
        (
            lambda: other(push=np.zeros((8, 2))),
            r"term 1, Traction is .*value=push\) in .*value=array \(8, 2\) 0, 0.0",
        ),
        (
            lambda: other(side=("top", "right")),
            r"surfaces/0/x is \('float64', \(8, 2\)\) .* here \('float64', \(16, 2\)\)",
        ),
    ],
    ids=[
        "grid",
        "FE",
        "mapping",
        "dt",
        "material",
        "points",
        "terms",
        "gravity",
        "function",
        "traction",
        "radius",
        "soil",
        "array",
        "surface",
    ],
)
def test_another_scene_is_refused_by_name_and_value(run, words, half):
    run, path = run(), half[0] / "elastic.npz"
    before = {name: value.copy() for name, value in run.state().items()}
    with pytest.raises(ValueError, match=f"elastic.npz: .*{words}"):
        run.restart(path)
    assert run.steps == 0 and all(
        np.array_equal(before[name], value) for name, value in run.state().items()
    )


def test_words_of_a_scene_are_the_same_in_another_process():
    """No address is in them, and round-off is not seen; numbers are."""

    class Law:
        def __init__(self, cohesion):
            self.cohesion, self.memory = cohesion, object()

    x = np.random.default_rng(1).normal(size=(9, 2))
    for one, two in (
        (Law(1.0), Law(1.0)),
        (x, x * (1 + 1e-14)),
        (lambda t: t, lambda t: 2 * t),
        (functools.partial(push, 1.0), functools.partial(push, 2.0)),
        (Law(2.0).__init__, Law.__init__),
    ):
        assert described(one) == described(two)
        assert " at 0x" not in described(one)
    for one, two in (
        (Law(1.0), Law(2.0)),
        (Law(x), Law(2 * x)),
        (Law((1.0, 2.0)), Law((1.0, 3.0))),
        (x, x[::-1]),
        (x, -x),
        (x, 2 * x),
        (x, x[:8]),
        ((1.0, 2.0), (1.0, 3.0)),
    ):
        assert described(one) != described(two)


def test_a_grid_whose_nodes_lie_elsewhere_is_refused(tmp_path):
    runs = []
    for width in (1.0, 1.0 + 1e-15):
        grid = mpm.Grid.box((0.0, 0.0), (width, 1.0), (2, 2))
        runs.append(mpm.FiniteElements(grid, SOFT, mpm.Newmark(1e-3), []))
    runs[0].record(mpm.Checkpoint(tmp_path / "state.npz"))
    runs[0].step()
    with pytest.raises(ValueError, match="grid is 4 cells in 2D, 9 nodes, places "):
        runs[1].restart(tmp_path / "state.npz")


def test_a_recorder_without_a_past_is_refused_and_one_that_is_gone_is_not_missed(half):
    run = points(SOFT)
    run.restart(half[0] / "elastic.npz")
    assert run.steps == STEPS
    for recorder in (mpm.Probe("stress", (0.5, 0.5)), mpm.Energy(), mpm.Energy()):
        run = points(SOFT)
        run.record(mpm.Energy())
        run.record(recorder)
        label = (
            "Energy 2" if isinstance(recorder, mpm.Energy) else r"Probe of stress at \[0.5 0.5\]"
        )
        with pytest.raises(
            ValueError,
            match=rf"recorder {label} is not in the checkpoint, which has \['Energy', 'Pro",
        ):
            run.restart(half[0] / "elastic.npz")
        assert run.steps == 0


@pytest.mark.parametrize(
    "spoil",
    [
        lambda b: b"",
        lambda b: b"a table of numbers",
        lambda b: b[: len(b) // 2],
        lambda b: b[:1000] + b"\xff\x00\xff" + b[1003:],
    ],
    ids=["empty", "other", "cut off", "flipped"],
)
def test_a_file_that_is_no_checkpoint_is_refused(spoil, half, tmp_path):
    path = tmp_path / "state.npz"
    path.write_bytes(spoil((half[0] / "FE.npz").read_bytes()))
    run = elements(SOFT)
    with pytest.raises(OSError, match=r"checkpoint not read: .*state\.npz") as caught:
        run.restart(path)
    assert "pickle" not in str(caught.value)
    with open(path, "wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(OSError, match=r"it is no checkpoint, .*: give the file that a recorder"):
        run.restart(path)
    np.savez(path, x=np.zeros(3))
    with pytest.raises(OSError, match="it is no checkpoint"):
        run.restart(path)
    with pytest.raises(FileNotFoundError, match=r"nowhere\.npz"):
        run.restart(tmp_path / "nowhere.npz")
    assert run.steps == 0


@pytest.mark.parametrize("every", (0, 1.5, "often"))
def test_every_below_one_is_refused(every, tmp_path):
    with pytest.raises(ValueError, match=f"every .*{every}"):
        mpm.Checkpoint(tmp_path / "state.npz", every=every)


def test_a_path_that_cannot_be_written_is_refused_when_attached(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    run = elements(SOFT)
    for path in (tmp_path / "file" / "state.npz", tmp_path / "folder"):
        with pytest.raises(
            OSError, match=rf"FE, step 0, t = 0: no checkpoint can be written: .*{path.name}"
        ) as caught:
            run.record(mpm.Checkpoint(path))
        assert isinstance(caught.value, mpm.RunError)
    with pytest.raises(ValueError, match="path must end in a name"):
        mpm.Checkpoint("results/")
    assert not run.recorders and not list((tmp_path / "folder").iterdir())


# -- other processes -------------------------------------------------------------------------------


def go_on(folder):
    """What the other process does."""
    for name, scene in SCENES.items():
        run = recorded(scene())
        run.restart(folder / f"{name}.npz")
        for _ in range(STEPS):
            run.step()
        mpm.Checkpoint(folder / f"{name} end.npz")(run)


BLOCKS = {"ksp_type": "cg", "pc_type": "asm", "pc_asm_type": "basic", "sub_pc_type": "icc"}


def on_ranks(folder):
    """Write, go back and go on, on each rank of several; a FE run and one of points that stay with
    their ranks."""

    def still():
        grid, fill = place(room=0)
        return mpm.Simulation(
            grid,
            fill(SOFT),
            mpm.Newmark(1e-4),
            [mpm.Fixed(grid.facets("bottom"), "y"), mpm.Gravity((0.0, -9.81))],
        )

    for name, scene in (
        ("points", still),
        (
            "FE",
            lambda: elements(
                SOFT,
                reassemble=True,
                solver=mpm.Solver(petsc=BLOCKS),
            ),
        ),
    ):
        run = recorded(scene())
        keep = run.record(mpm.Checkpoint(folder / f"{name} ranks.npz", every=STEPS))
        run.until(STEPS * run.stepping.dt)
        run.recorders.remove(keep)
        run.until(2 * STEPS * run.stepping.dt)
        end = {**run.state(), **of_recorders(run)}
        again = recorded(scene())
        again.restart(folder / f"{name} ranks.npz")
        again.until(2 * STEPS * run.stepping.dt)
        same({**again.state(), **of_recorders(again)}, end)
        try:
            again.restart(folder / "nowhere.npz")
        except FileNotFoundError:
            print("refused", flush=True)


def of_recorders(run):
    """What its recorders hold."""
    return {f"{k}": recorder.values for k, recorder in enumerate(run.recorders)}


def test_two_ranks_go_on_bit_for_bit_and_a_file_that_is_gone_is_named(tmp_path):
    assert test_ranks.on_ranks(2, __file__, tmp_path, "ranks").count("refused") == 4
    (gone,) = tmp_path.glob("FE ranks.npz.*.1")
    gone.unlink()
    with pytest.raises(FileNotFoundError, match=rf"the checkpoint names {gone.name} beside it"):
        elements(SOFT).restart(tmp_path / "FE ranks.npz")


if __name__ == "__main__":
    (on_ranks if sys.argv[2:] == ["ranks"] else go_on)(Path(sys.argv[1]))
