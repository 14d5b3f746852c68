"""Killed twenty times at random, and started again on other numbers of ranks each time, a run comes
to the end that it has without."""

import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import swinging
from test_ranks import environment, mpiexec

import mpm_fenicsx as mpm

pytestmark = pytest.mark.validation
KILLS = 20
TOLERANCE = 1e-9


def test_twenty_deaths(tmp_path):
    program = mpiexec()
    if program is None:
        pytest.skip("no mpiexec beside Python or on PATH")
    dice, file, starts = random.Random(7), tmp_path / "state.npz", []
    for kill in range(KILLS + 1):
        ranks = dice.choice((1, 2, 3)) if kill else 1  # so that points' numbers are their rows
        life = subprocess.Popen(
            [
                *(program, "-n", str(ranks), sys.executable, "-m", "mpi4py"),
                *(swinging.__file__, str(file)),
            ],
            env=environment(),
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        starts.append(int(life.stdout.readline().split()[1]))
        if kill < KILLS:
            time.sleep(dice.uniform(0.0, 1.5) + (kill == 0))
            os.killpg(life.pid, signal.SIGKILL)
        life.communicate(timeout=900)
    assert life.returncode == 0
    assert starts == sorted(starts) and starts[-1] < swinging.STEPS, starts
    assert len(set(starts)) > KILLS // 2, starts
    subprocess.run(
        [sys.executable, swinging.__file__, str(tmp_path / "never.npz")],
        check=True,
        env=environment(),
    )
    found, never = (swinging.scene() for _ in range(2))
    for run, name in ((found, "state.npz"), (never, "never.npz")):
        run.record(mpm.Probe("velocity", (0.5, 0.5)))
        run.record(mpm.Energy())
        run.restart(tmp_path / name)
        assert run.steps == swinging.STEPS
    for name, b in never.state().items():
        if name == "solver":  # several ranks have another
            continue
        a, size = found.state()[name], np.abs(b).max(initial=0.0)
        assert np.allclose(a, b, rtol=0.0, atol=TOLERANCE * size), name
    for a, b in zip(found.recorders, never.recorders, strict=True):
        assert np.array_equal(a.times, b.times)
        assert np.allclose(a.values, b.values, rtol=0.0, atol=TOLERANCE * np.abs(b.values).max())
    left = sorted(p.name for p in tmp_path.iterdir() if ".part" not in p.name)
    assert sum(name.startswith("state.npz") for name in left) <= 1 + ranks, left
