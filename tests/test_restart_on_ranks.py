"""A run that goes on from its checkpoint on more ranks, on fewer, and on one again is the run that
was never stopped.

As a script: ``mpiexec -n N python test_restart_on_ranks.py folder stage`` goes on from the stage
before, and writes checkpoints of this one.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_checkpoint import CLAY, SOFT, STRETCHED, elements, place, push, recorded
from test_ranks import on_ranks

import mpm_fenicsx as mpm

STEPS = 4
TOLERANCE = 1e-10
"""Of the largest value of an array; the solver stops at 1e-13, Newton's method at 1e-12."""
STAGES = (1, 2, 3, 1)
"""Ranks of one stage after the other."""
EXACT = mpm.Solver(
    newton=mpm.Newton(tolerance=1e-12), petsc={"ksp_rtol": 1e-13, "ksp_max_it": 2000}
)


def points(law, mapping=mpm.DM_GC, *more):
    """A body that crosses cells on springs and dashpots, with pressure given point by point."""
    grid, fill = place()
    body = fill(law)
    body.velocity = np.tile((6.0, -0.3), (len(body), 1))
    top = body.surface("top")
    pressure = np.column_stack((np.zeros(len(top)), -2e3 - 8e3 * top.x[:, 0]))
    return mpm.Simulation(
        grid,
        body,
        mpm.Newmark(5e-3),
        [
            mpm.Gravity((0.0, -9.81)),
            mpm.Traction(top, pressure),
            mpm.ViscoelasticBoundary(body.surface("bottom"), SOFT, 3.0),
            mpm.Traction(body.surface("left"), (1e3, 1e3)),
            *more,
        ],
        mapping,
        EXACT,
    )


def shaken():
    """Two bodies on a base that moves as a record says."""
    grid, _ = place(room=0)
    left, right = (
        mpm.MaterialPoints.fill(
            grid, law, 4, lambda x, a=a: (abs(x[0] - a - 0.25) < 0.25) & (x[1] < 1.0), jitter=0.2
        )
        for law, a in ((CLAY, 0.0), (SOFT, 0.5))
    )
    return mpm.Simulation(
        grid,
        [left, right],
        mpm.Newmark(5e-3),
        [
            mpm.Fixed(grid.facets("bottom"), "y"),
            mpm.Fixed(grid.facets("bottom"), "x", acceleration=lambda t: 3.0 + 40.0 * t),
            mpm.Traction(left.surface("top"), push),
        ],
        mpm.GIMP,
        EXACT,
    )


SCENES = {
    "elastic": lambda: points(SOFT),
    "B-bar": lambda: points(CLAY, replace(mpm.DM_GC, b_bar=True)),
    "finite von Mises": lambda: points(STRETCHED),
    "GhostPenalty": lambda: points(SOFT, mpm.DM_GC, mpm.GhostPenalty()),
    "two bodies": shaken,
    "FE": lambda: elements(SOFT, reassemble=True, solver=EXACT),
    "FE von Mises": lambda: elements(CLAY, solver=mpm.Solver(newton=EXACT.newton)),
    "FE Hencky": lambda: elements(STRETCHED, solver=mpm.Solver(newton=EXACT.newton)),
}


def go_on(folder, stage):
    """One stage of all scenes."""
    for name, scene in SCENES.items():
        run = recorded(scene())
        if stage:
            run.restart(folder / f"{name} {stage - 1}.npz")
        for _ in range(STEPS):
            run.step()
        mpm.Checkpoint(folder / f"{name} {stage}.npz")(run)


@pytest.fixture(scope="module")
def end(tmp_path_factory):
    """The folder of the checkpoints after all stages."""
    folder = tmp_path_factory.mktemp("stages")
    for stage, ranks in enumerate(STAGES):
        on_ranks(ranks, __file__, folder, stage)
    return folder


@pytest.mark.ranks
@pytest.mark.parametrize("name", SCENES)
def test_other_ranks_go_on(name, end, tmp_path):
    run = recorded(SCENES[name]())
    for _ in range(STEPS * len(STAGES)):
        run.step()
    mpm.Checkpoint(tmp_path / "never stopped.npz")(run)
    with (
        np.load(tmp_path / "never stopped.npz") as never,
        np.load(end / f"{name} {len(STAGES) - 1}.npz") as stages,
    ):
        lacking = set(never) ^ set(stages)
        assert all(array.endswith("/number") for array in lacking), lacking
        for array in set(never) - lacking:
            if array.startswith(("0/run/", "0/recorders/")) and array != "0/run/solver":
                a, b = stages[array], never[array]
                assert a.shape == b.shape and a.dtype == b.dtype, array
                size = np.abs(b).max(initial=0.0) if b.dtype.kind == "f" else 0.0
                assert np.allclose(a, b, rtol=0.0, atol=TOLERANCE * size), array


if __name__ == "__main__":
    go_on(Path(sys.argv[1]), int(sys.argv[2]))
