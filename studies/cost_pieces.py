"""Who spends the time of a step: clocks around the methods of a run, from outside, and the memory
of the process."""

from __future__ import annotations

import ctypes
import functools
import gc
import time
from collections import defaultdict

from mpi4py import MPI  # noqa: F401  before petsc4py: it loads the MPI library of the wheel

from petsc4py import PETSc

PIECES = (
    "locate",
    "project",
    "predict",
    "load",
    "force",
    "assemble",
    "factor",
    "solve",
    "recover",
    "correct",
    "carry",
    "record",
    "other",
)
POINTS = ("locate", "project", "recover", "carry")  # the points' own work, as the issue counts it


class Bill:
    """Seconds of each piece of a run's steps, without the pieces inside it.

    ``force``: internal force and residual; ``assemble``: K; ``factor``: PETSc's preconditioner;
    ``correct``: what makes accelerations fit the points' force, its solve included; ``other``: the
    rest.
    """

    def __init__(self, run):
        self.run, self.seconds, self._inside = run, defaultdict(float), [0.0]
        equilibrium = run.equilibrium
        self._watch(run, "step", "other")
        self._watch(run, "finish", "record")
        self._watch(run, "carry", "carry")
        self._watch(run.scene, "prepare", "load")
        self._watch(equilibrium, "assemble_tangent", "assemble")
        self._watch(equilibrium, "solve", "force")
        self._watch(equilibrium, "correct", "solve")
        if run.bodies:
            for name in ("locate", "project", "predict"):
                self._watch(run, name, name)
            self._watch(run, "solve", "force")
            for owner in (*run.composites, *run.stencils):
                self._watch(owner, "gradient_at_points", "recover")
            if run.correction is not None:
                self._watch(run.correction, "correct", "correct")
        PETSc.Log.begin()
        self._factor = PETSc.Log.Event("PCSetUp")

    def _watch(self, owner, method: str, piece: str) -> None:
        call = getattr(owner, method)

        @functools.wraps(call)
        def timed(*arguments, **named):
            self._inside.append(0.0)
            start = time.perf_counter()
            try:
                return call(*arguments, **named)
            finally:
                spent = time.perf_counter() - start
                self.seconds[piece] += spent - self._inside.pop()
                self._inside[-1] += spent

        setattr(owner, method, timed)

    def block(self, steps: int) -> dict[str, float]:
        """Take some steps: seconds a step of each piece."""
        self.seconds.clear()
        before = self._factor.getPerfInfo()["time"]
        for _ in range(steps):
            self.run.step()
        factor = self._factor.getPerfInfo()["time"] - before
        self.seconds["factor"] += factor
        self.seconds["solve"] -= factor
        return {piece: self.seconds[piece] / steps for piece in PIECES}


def middle(blocks: list[dict[str, float]]) -> dict[str, float]:
    """The block whose total is the (lower) median: its pieces add up to it."""
    return sorted(blocks, key=total)[(len(blocks) - 1) // 2]


def total(block: dict[str, float]) -> float:
    """Seconds a step."""
    return sum(block.values())


def resident() -> int:
    """Memory of this process now (bytes), what was freed given back; the peak is counted from
    here."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")
    return _status("VmRSS")


def peak() -> int:
    """Largest memory of this process since ``resident`` (bytes)."""
    return _status("VmHWM")


def _status(name: str) -> int:
    with open("/proc/self/status") as file:
        return next(1024 * int(line.split()[1]) for line in file if line.startswith(name))
