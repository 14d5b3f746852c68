"""The same scene on more ranks: how much less a step takes, what is sent for it, what balance is
worth, and where that leads to on a cluster.

    network   a small and a large message between two ranks, a sum over all
    strong    a block at Courant 1, DM-GC, elastic, on one rank and on several, which take turns
    weak      as many points a rank on one rank and on several
    moving    the block slides 0.1 cells a step and its points go from rank to rank
    balance   a column collapses on a slope, with ``Repartition`` and without; CPU time of the
              slowest rank, for who waits does no work
    model     constants of ``scaling_model``, and a step with 1e9 points on 1,000 ranks

All runs of a case are alive at once and take turns, a few steps at a time; one that waits sleeps.
One rank takes an incomplete factor unless told otherwise, several take Jacobi's preconditioner, so
that one rank runs with either, and ratios are to its own best.  Rows are kept in
results/scaling.json, which a broken run goes on from; the figure is beside it.

    OMP_NUM_THREADS=1 python studies/scaling.py [--quick] [--again] [--ranks 1,2,4]
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from contextlib import ExitStack, suppress
from pathlib import Path

from mpi4py import MPI  # noqa: F401  before dolfinx: it loads the MPI library of the wheel

import numpy as np
import report
from rich.console import Console
from rich.progress import track

ANSWER = "answer: "  # how lines begin that answer an order
SHARING = {  # where ranks share cores, or CPU time counts: who waits sleeps, or lets others in
    "MPIR_CVAR_ENABLE_HEAVY_YIELD": "1",
    "OMPI_MCA_mpi_yield_when_idle": "1",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
}
BLOCK, WARM = 3, 1  # steps in a turn; turns before the clock counts
WATCHED = 10  # steps whose messages are counted: points cross a line of the grid in some of them
SIZES = {  # cells of the block along each direction, by kind and dimension
    "strong": {2: (384, 256), 3: (40, 20, 20)},
    "weak": {2: (96, 64), 3: (20, 10, 10)},
    "moving": {2: (96, 64), 3: (40, 10, 10)},
}
QUICK = {
    "strong": {2: (96, 64), 3: (16, 8, 8)},
    "weak": {2: (32, 24), 3: (8, 4, 4)},
    "moving": {2: (32, 24), 3: (16, 8, 8)},
}
CELL, END = 0.125, 2.0  # m, s: of the collapse
KEYS = ("kind", "dim", "counts", "cell", "ranks", "quick")


def mpiexec() -> str:
    """The mpiexec of this Python's MPI: beside it, or on PATH."""
    beside = Path(sys.executable).parent / "mpiexec"
    found = str(beside) if beside.exists() else shutil.which("mpiexec")
    if found is None:
        sys.exit(f"mpiexec is neither beside {sys.executable} nor on PATH: this study needs it")
    return found


def environment(sharing: bool) -> dict[str, str]:
    """For ranks that are started: without what MPI told this process about itself."""
    own = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPIR_CVAR_ENABLE_HEAVY_YIELD")
    kept = {key: value for key, value in os.environ.items() if not key.startswith(own)}
    path = os.pathsep.join([str(report.HOME), *filter(None, [os.environ.get("PYTHONPATH")])])
    return {
        **kept,
        "PYTHONPATH": path,
        "OMP_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        **(SHARING if sharing else {}),
    }


class Ranks:
    """A scene on so many ranks, in processes of their own; see ``scaling_worker``.

    ``sharing``: who waits sleeps; so it is wherever the machine is ``busy``, or has fewer cores.
    """

    busy = False

    def __init__(self, count: int, sharing: bool = False, **scene):
        cores = len(os.sched_getaffinity(0))
        program = [mpiexec(), "-n", str(count), sys.executable, "-m", "mpi4py", __file__]
        self._words = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen(
            [*program, "--worker", json.dumps(scene)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._words,
            text=True,
            env=environment(sharing or self.busy or count > cores),
        )

    def ask(self, do: str, **what):
        """What the ranks answer to an order."""
        with suppress(BrokenPipeError):
            print(json.dumps({"do": do, **what}), file=self.process.stdin, flush=True)
        for line in self.process.stdout:
            if line.startswith(ANSWER):
                return json.loads(line.removeprefix(ANSWER))
        self._words.seek(0)
        raise RuntimeError("the ranks stopped:\n" + self._words.read()[-2000:])

    def close(self) -> None:
        """No more orders."""
        with suppress(BrokenPipeError):
            self.process.stdin.close()
        try:
            self.process.wait(timeout=60)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()
        self._words.close()


def started(stack: ExitStack, scenes: dict[str, dict]) -> dict[str, Ranks]:
    """Runs by name, each of which is ready before the next is started; closed with the stack."""
    runs = {}
    for name, scene in scenes.items():
        runs[name] = Ranks(**scene)
        stack.callback(runs[name].close)
        runs[name].ask("ready")
    return runs


def turns(runs: dict[str, Ranks], rounds: int, block: int = BLOCK) -> dict[str, list[dict]]:
    """What each run answers in each round but the first ones."""
    found = {name: [] for name in runs}
    for number in range(WARM + rounds):
        for name, run in runs.items():
            answer = run.ask("steps", count=block)
            if number >= WARM:
                found[name].append(answer)
    return found


def middle(answers: list[dict]) -> dict:
    """The answer whose seconds are the (lower) median, with that of CPU seconds and the mean share
    of points that left their rank."""
    of_all = sorted(answers, key=lambda answer: answer["wall"])
    return {
        **of_all[(len(of_all) - 1) // 2],
        "cpu": float(np.median([answer["cpu"] for answer in answers])),
        "gone": float(np.mean([answer["gone"] for answer in answers])),
    }


def spread(of: list[dict], to: list[dict]) -> list[float]:
    """Median and quartiles of the ratios of seconds in turns."""
    ratios = [a["wall"] / b["wall"] for a, b in zip(of, to, strict=True)]
    return np.percentile(ratios, (50, 25, 75)).tolist()


def blocks(case: dict, rounds: int) -> dict:
    """A block on one rank and on several, in turns: "strong", "weak" or "moving"."""
    counts, kind = case["counts"], case["kind"]
    several = [n for n in case["ranks"] if n > 1]
    scene = {"scene": "block", "dim": case["dim"], "sliding": kind == "moving"}

    def of(count: int, **more) -> dict:
        wide = [counts[0] * count, *counts[1:]] if kind == "weak" else counts
        return {"count": count, "counts": wide, **scene, **more}

    scenes = {"1": of(1), "1, Jacobi": of(1, jacobi=True), **{str(n): of(n) for n in several}}
    with ExitStack() as stack:
        runs = started(stack, scenes)
        found = turns(runs, rounds)
        rows = {name: middle(answers) for name, answers in found.items()}
        for name, run in runs.items():
            rows[name] |= run.ask("memory")
            if name in map(str, several):
                rows[name]["volume"] = run.ask("volume", count=WATCHED)
                rows[name]["division"] = run.ask("divide")
    best = min(("1", "1, Jacobi"), key=lambda name: rows[name]["wall"])
    return {
        **case,
        "points": int(np.prod(counts)) * 2 ** case["dim"],
        "runs": rows,
        "best": best,
        "ratios": {str(n): spread(found[best], found[str(n)]) for n in several},
        "ratios_jacobi": {str(n): spread(found["1, Jacobi"], found[str(n)]) for n in several},
    }


def network(case: dict) -> dict:
    """Latency, bandwidth and sums on each number of ranks."""
    rows = {}
    for n in (n for n in case["ranks"] if n > 1):
        with ExitStack() as stack:
            row = started(stack, {"": {"count": n, "scene": "none"}})[""].ask("network")
        rows[str(n)] = {**row, "level_s": row["sum_s"] / np.log2(n)}
    return {**case, "points": 0, "runs": rows}


def balance(case: dict, end: float, block: int = 5) -> dict:
    """The collapse, with ``Repartition`` and without, in turns; a division counts by itself."""
    many = max(case["ranks"])
    scene = {"count": many, "sharing": True, "scene": "collapse", "cell": case["cell"]}
    scenes = {name: {**scene, "balance": name == "with"} for name in ("without", "with")}
    series = {name: [] for name in scenes}
    with ExitStack() as stack:
        runs = started(stack, scenes)
        while not series["with"] or series["with"][-1]["time"] < end - 1e-9:
            for name, run in runs.items():
                answer = run.ask("steps", count=block)
                wanted = ("time", "cpu", "imbalance", "solves", "iterations", "points")
                series[name].append({key: answer[key] for key in wanted})
        divisions = runs["with"].ask("divided")
    cpu = {name: float(np.mean([at["cpu"] for at in of])) for name, of in series.items()}
    gain = cpu["without"] - cpu["with"]
    each = float(np.mean([one["cpu"] for one in divisions])) if divisions else None
    steps = block * len(series["with"])
    return {
        **case,
        "dim": 2,
        "points": sum(series["with"][-1]["points"]),
        "steps": steps,
        "cpu": cpu,
        "divisions": divisions,
        "division_cpu": each,
        "division_steps": None if each is None else each / cpu["with"],
        "pays_after_steps": None if each is None or gain <= 0.0 else each / gain,
        "whole": (cpu["with"] + sum(d["cpu"] for d in divisions) / steps) / cpu["without"],
        "series": series,
    }


def cases(quick: bool, ranks: list[int]) -> list[dict]:
    """What is measured."""
    sizes = QUICK if quick else SIZES
    todo = [
        {"kind": kind, "dim": dim, "counts": list(of[dim]), "cell": None}
        for kind, of in sizes.items()
        for dim in (2, 3)
    ]
    todo += [{"kind": "balance", "dim": 2, "counts": None, "cell": CELL * (4 if quick else 2)}]
    todo = [{"kind": "network", "dim": None, "counts": None, "cell": None}, *todo]
    return [{**case, "ranks": ranks, "quick": quick} for case in todo]


def measure(case: dict) -> dict:
    """The row of one case."""
    quick = case["quick"]
    if case["kind"] == "network":
        row = network(case)
    elif case["kind"] == "balance":
        row = balance(case, END / 2 if quick else END)
    else:
        row = blocks(case, 4 if quick else 8)
    return {**row, "dolfinx": report.dolfinx()}


def same(row: dict, case: dict) -> bool:
    """Whether a row is that of a case."""
    return all(row.get(key) == case[key] for key in KEYS)


def numbers(text: str) -> list[int]:
    """Numbers of ranks, such as "1,2,4"; one is always among them."""
    found = sorted({1, *map(int, text.split(","))})
    if found[0] < 1 or 2 not in found:
        raise argparse.ArgumentTypeError(f"ranks must be such as 1,2,4, with 2 among them: {text}")
    return found


def main(arguments=None) -> list[dict]:
    """Measure what is not there yet, fit the model, print tables, draw the figure."""
    parser = report.parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="small scenes")
    parser.add_argument("--again", action="store_true", help="measure also what is there already")
    parser.add_argument("--ranks", type=numbers, default=[1, 2], help="such as 1,2,4")
    parser.add_argument(
        "--busy", action="store_true", help="who waits sleeps: for a machine that does other work"
    )
    parser.add_argument("--worker", type=json.loads, help=argparse.SUPPRESS)
    chosen = report.chosen(parser, arguments)
    if chosen.worker:
        import scaling_worker

        scaling_worker.serve(chosen.worker, ANSWER)
        return []
    import scaling_model
    import scaling_report

    Ranks.busy = chosen.busy
    path, todo = chosen.results / "scaling.json", cases(chosen.quick, chosen.ranks)
    rows = json.loads(path.read_text()) if path.exists() and not chosen.again else []
    rows = [row for row in rows if any(same(row, case) for case in todo)]
    for case in track(todo, "scaling"):
        if not any(same(row, case) for row in rows):
            rows.append(report.rounded(measure(case), 4, KEYS))
            report.write(path, rows)
    rows.append(report.rounded({"kind": "model", **scaling_model.projection(rows)}, 4))
    report.write(path, rows)
    scaling_report.figure(rows, chosen.results / "scaling.png")
    for table in scaling_report.tables(rows):
        Console(width=150).print(table)
    return rows


if __name__ == "__main__":
    main()
