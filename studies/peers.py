"""Our step beside that of a peer: Kratos' implicit material point method, on the same grid, points
and steps.

    column   20 m × 1 m, h = 0.25 m, 4 points a cell, fixed base, a triangle of 300 kPa (and of 0.3
             kPa), Δt = 2.5 ms; error of the pressure at mid-height against the exact column
    block    6 m × 4 m, 96 × 64 cells, 24,576 points, a pulse on a strip, Δt = 5 ms; no exact
             answer, so the vertical stress 1 m below the strip is compared with the finite element
             twin's

All take turns, a few steps at a time, one thread each.  Kratos lives in a Python of its own:

    python -m venv kratos && kratos/bin/pip install KratosMultiphysics KratosMPMApplication
    OMP_NUM_THREADS=1 python studies/peers.py --kratos-python kratos/bin/python

Without it ours run alone.  Writes results/peers.json.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import cost_scenes
import numpy as np
import report
from rich.console import Console
from rich.progress import track
from rich.table import Table

from mpm_fenicsx import DM_GC, MPM, FiniteElements, Probe, Simulation
from mpm_fenicsx.analytical import waves
from mpm_fenicsx.scenes import column, pressed_block

SCRIPT = Path(__file__).with_name("peers_kratos.py")
INSTALL = "pip install KratosMultiphysics KratosMPMApplication"
# of Kratos' laws the one with fewest iterations and least error here
LAW = "HyperElasticNeoHookeanPlaneStrain2DLaw"
AMGCL = {
    "solver_type": "amgcl",
    "smoother_type": "ilu0",
    "krylov_type": "cg",
    "coarsening_type": "aggregation",
    "max_iteration": 200,
    "tolerance": 1e-7,
    "verbosity": 0,
    "scaling": False,
}
PEERS = {"Kratos, Newton": True, "Kratos, one solve": False}


def alone() -> dict[str, str]:
    """The environment of a process with one thread and its own Python packages."""
    return {
        **{key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
        "OMP_NUM_THREADS": "1",
    }


@dataclass
class Ours:
    """A run of ours and the probe that reads its vertical stress."""

    run: Simulation | FiniteElements
    probe: Probe

    def advance(self, steps: int) -> float:
        """Seconds of some steps."""
        start = time.perf_counter()
        for _ in range(steps):
            self.run.step()
        return time.perf_counter() - start

    @property
    def pressure(self) -> np.ndarray:
        """Pressure (Pa) after each step."""
        return -self.probe.values[1:, 1]


@dataclass
class Peer:
    """A run of Kratos in a process of its own; see ``peers_kratos``."""

    python: str
    scene: dict
    weights: np.ndarray
    stress: list = field(default_factory=list)
    iterations: int = 0

    def __post_init__(self) -> None:
        reading, writing = os.pipe()
        self._answers, self._words = os.fdopen(reading), tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen(
            [self.python, str(SCRIPT), str(writing)],
            stdin=subprocess.PIPE,
            stdout=self._words,
            stderr=subprocess.STDOUT,
            text=True,
            pass_fds=[writing],
            env=alone(),
        )
        os.close(writing)
        self.version = self._ask(json.dumps(self.scene))["version"]

    def _ask(self, order: str) -> dict:
        with suppress(BrokenPipeError):
            print(order, file=self.process.stdin, flush=True)
        answer = self._answers.readline()
        if not answer:
            self._words.seek(0)
            raise RuntimeError("Kratos stopped:\n" + self._words.read()[-2000:])
        return json.loads(answer)

    def advance(self, steps: int) -> float:
        """Seconds of some steps."""
        answer = self._ask(str(steps))
        self.stress += answer["stress"]
        self.iterations += answer["iterations"]
        return answer["seconds"]

    @property
    def pressure(self) -> np.ndarray:
        """Pressure (Pa) after each step."""
        return -np.array(self.stress) @ self.weights

    def close(self) -> None:
        """No more orders."""
        with suppress(BrokenPipeError):
            self.process.stdin.close()
        self.process.wait()
        self._answers.close()
        self._words.close()


def told(
    run: Simulation, fixed: dict, side: np.ndarray, probe: Probe, pressure: np.ndarray
) -> tuple[dict, np.ndarray]:
    """The scene of a run in numbers, and the weights of the points that the probe reads."""
    lattice, body, soil = run.grid.lattice, run.bodies[0], run.bodies[0].material
    lines = [np.union1d(lattice.lower[:, d], lattice.upper[:, d]).tolist() for d in range(2)]
    order = np.argsort(probe._rows)
    return {
        "lines": lines,
        "x": body.x.tolist(),
        "half": body.half.tolist(),
        "young": soil.young,
        "poisson": soil.poisson,
        "density": soil.density,
        "law": LAW,
        "fixed": fixed,
        "load_at": side.x.tolist(),
        "load_area": side.area.tolist(),
        "pressure": pressure.tolist(),
        "dt": run.stepping.dt,
        "rows": probe._rows[order].tolist(),
        "linear_solver": AMGCL,
    }, probe._weights[order]


def turns(runs: dict, steps: int, block: int, label: str) -> dict[str, np.ndarray]:
    """Seconds a step of each block of each run; runs take turns."""
    found = {name: [] for name in runs}
    for _ in track(range(steps // block), label):
        for name, run in runs.items():
            found[name].append(run.advance(block) / block)
    return {name: np.array(seconds) for name, seconds in found.items()}


def with_peers(runs: dict, python: str | None, scene: dict, weights: np.ndarray) -> dict:
    """The runs and, where there is a Python for them, Kratos'."""
    if python:
        runs |= {
            name: Peer(python, {**scene, "newton": newton}, weights)
            for name, newton in PEERS.items()
        }
    return runs


def rows_of(
    case: str, runs: dict, seconds: dict[str, np.ndarray], known: np.ndarray, skip: int = 1
) -> list[dict]:
    """A row a run; ``known`` (steps,), Pa; the first blocks are no measure of time."""
    rows = []
    for name, run in runs.items():
        s, peer = seconds[name][skip:], isinstance(run, Peer)
        rows.append(
            {
                "case": case,
                "method": name,
                "seconds": float(np.median(s)),
                "seconds_min": float(s.min()),
                "over_dm_gc": float(np.median(s / seconds["DM-GC"][skip:])),
                "error_pressure": waves.relative_error(run.pressure, known),
                "solves_a_step": max(1.0, run.iterations / len(known)) if peer else 1.0,
                "version": run.version if peer else report.dolfinx(),
            }
        )
        if peer:
            run.close()
    return rows


def of_column(
    python: str | None, load: float, dt: float = 2.5e-3, end: float = column.end
) -> list[dict]:
    """The demo's column on its fixed base."""
    runs, middle = {}, (0.5, column.height / 2)
    for mapping in (DM_GC, MPM):
        run = column.material_points("fixed", load, mapping, step=dt)
        runs[mapping.name] = Ours(run, run.record(Probe("stress", middle)))
    twin = column.finite_elements("fixed", load, step=dt)
    runs["FE"] = Ours(twin, twin.record(Probe("stress", middle)))
    steps, ours = round(end / dt), runs["DM-GC"]
    t = dt * np.arange(1, steps + 1)
    scene, weights = told(
        ours.run,
        {"left": "x", "right": "x", "bottom": "y"},
        ours.run.bodies[0].surface("top"),
        ours.probe,
        column.pulse(t, load),
    )
    runs = with_peers(runs, python, scene, weights)
    seconds = turns(runs, steps, 20, f"column, {load / 1e3:g} kPa")
    known = column.answer("fixed", load).pressure(column.height / 2, t)
    return rows_of(f"column, {load / 1e3:g} kPa", runs, seconds, known)


def of_block(python: str | None, cell: float = 0.0625, steps: int = 40) -> list[dict]:
    """The strip on the elastic block."""
    at = (3.0, 3.0)
    runs = {}
    for name in ("DM-GC", "MPM", "FE"):
        run = cost_scenes.scene(name, 2, cell)
        runs[name] = Ours(run, run.record(Probe("stress", at)))
    ours = runs["DM-GC"]
    t = ours.run.stepping.dt * np.arange(1, steps + 1)
    scene, weights = told(
        ours.run,
        {"left": "x", "right": "x", "bottom": "xy"},
        ours.run.bodies[0].surface("top", where=pressed_block.under_strip),
        ours.probe,
        pressed_block.pulse(t),
    )
    runs = with_peers(runs, python, scene, weights)
    seconds = turns(runs, steps, 4, "block")
    return rows_of("block", runs, seconds, runs["FE"].pressure, skip=2)


def has_kratos(python: str) -> bool:
    """Whether a Python can import Kratos' MPM application."""
    command = [python, "-c", "import KratosMultiphysics.MPMApplication"]
    with suppress(OSError):
        return subprocess.run(command, capture_output=True, env=alone()).returncode == 0
    return False


def table(rows: list[dict]) -> Table:
    """Milliseconds a step and errors."""
    found = Table(
        "case",
        "method",
        "ms a step",
        "least",
        "÷ DM-GC",
        "solves a step",
        "error of pressure, %",
        title="One thread each, taking turns; block: difference from FE",
        box=None,
        padding=(0, 2, 0, 0),
    )
    for row in rows:
        found.add_row(
            row["case"],
            row["method"],
            f"{1e3 * row['seconds']:.2f}",
            f"{1e3 * row['seconds_min']:.2f}",
            f"{row['over_dm_gc']:.2f}",
            f"{row['solves_a_step']:.2f}",
            f"{100 * row['error_pressure']:.2f}",
        )
    return found


def main(arguments=None) -> list[dict]:
    """Run all cases, print the table, write results/peers.json."""
    parser = report.parser(__doc__)
    parser.add_argument(
        "--kratos-python", default=sys.executable, metavar="PATH", help="a Python that has Kratos"
    )
    chosen = report.chosen(parser, arguments)
    python = chosen.kratos_python if has_kratos(chosen.kratos_python) else None
    if python is None:
        print(
            f"Kratos is not installed in {chosen.kratos_python}, ours run alone; to have it: "
            f"{INSTALL}"
        )
    rows = [*of_column(python, column.peak), *of_column(python, column.small), *of_block(python)]
    report.write(chosen.results / "peers.json", rows)
    Console(width=120).print(table(rows))
    return rows


if __name__ == "__main__":
    main()
