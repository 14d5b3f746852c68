"""What a material point run and a finite element run share: time, recorders, and honest failure."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from .checks import finite
from .grid import Grid
from .newton import SolverError
from .time_stepping import Newmark, QuasiStatic

FIELDS = ("displacement", "velocity", "acceleration", "stress")


class RunError(RuntimeError):
    """A run that cannot go on; names the step and its time.  What was recorded before is kept."""


class Run:
    """Steps in time and calls recorders after each step."""

    def __init__(self, name: str, grid: Grid, stepping: Newmark | QuasiStatic):
        self.name, self.grid, self.stepping = name, grid, stepping
        self.steps = 0
        self.recorders: list[Callable] = []
        self.collectors: list[Callable] = []

    @property
    def time(self) -> float:
        """Time reached (s; load parameter when quasi-static)."""
        return self.steps * self.stepping.dt

    @property
    def next_time(self) -> float:
        """Time at the end of the step to come."""
        return (self.steps + 1) * self.stepping.dt

    def step(self) -> None:
        """One step."""
        raise NotImplementedError

    def sampler(self, field: str) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
        """Places (n, dim) where the run knows a field, and a function from rows to values there."""
        raise NotImplementedError

    def energy(self) -> dict[str, float]:
        """Kinetic and strain energy (J) of this rank's part of the body."""
        raise NotImplementedError

    def record(self, recorder):
        """Attach a recorder: called after each step, and once now for the start.  Returns it."""
        recorder.attach(self)
        self.recorders.append(recorder)
        return recorder

    def until(self, t: float, progress: Callable[[int], None] | None = None) -> None:
        """Step until time ``t`` (s); ``progress`` is called with the number of steps done."""
        last = round(finite("t", t) / self.stepping.dt)
        while self.steps < last:
            self.step()
            if progress is not None:
                progress(self.steps)

    def finish(self) -> None:
        """End of a step: time goes on, recorders look."""
        self.steps += 1
        for recorder in self.recorders:
            recorder(self)

    def collect(self) -> None:
        """After each solve, of which a step can need several: what adds up over time is added up."""
        for collector in self.collectors:
            collector(self)

    @contextmanager
    def reported(self) -> Iterator[None]:
        """Name step and time in whatever goes wrong inside a step."""
        try:
            yield
        except (SolverError, RunError, ValueError, FloatingPointError) as error:
            raise RunError(f"{self.name}, step {self.steps + 1}, t = {self.next_time:.6g}: {error}") from error
