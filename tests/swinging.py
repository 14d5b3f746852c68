"""A block that swings over the boundaries of ranks and writes checkpoints: ``mpiexec -n N python
swinging.py file`` goes on from the last one, if there is one."""

import sys
from pathlib import Path

import numpy as np
from test_restart_on_ranks import EXACT, SOFT, place

import mpm_fenicsx as mpm

STEPS, EVERY = 2400, 5


def scene():
    """A block that swings to and fro over the boundaries of ranks, on springs."""
    grid, fill = place(room=2)
    body = fill(SOFT)
    return mpm.Simulation(
        grid,
        body,
        mpm.Newmark(2e-3),
        [
            mpm.ViscoelasticBoundary(body.surface("bottom"), SOFT, 3.0),
            mpm.Traction(body.surface("left"), lambda t: (3e4 * np.cos(9.0 * t), 0.0)),
            mpm.Traction(body.surface("top"), lambda t: (0.0, 1e4 * np.sin(7.0 * t))),
        ],
        solver=EXACT,
    )


def life(file: Path) -> None:
    """From the last checkpoint to the end, if nobody kills it."""
    run = scene()
    run.record(mpm.Probe("velocity", (0.5, 0.5)))
    run.record(mpm.Energy())
    run.record(mpm.Checkpoint(file, every=EVERY))
    if file.exists():
        run.restart(file)
    if run.grid.comm.rank == 0:
        print(f"from {run.steps}", flush=True)
    while run.steps < STEPS:
        run.step()


if __name__ == "__main__":
    life(Path(sys.argv[1]))
