"""What a material point run and a finite element run share: time, recorders, and honest failure."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from .checks import finite, positive, whole
from .grid import Grid
from .newton import SolverError
from .reactions import tractions
from .terms import Traction
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

    def balance(self) -> tuple[np.ndarray, float]:
        """What supports bear as things stand (dofs,), N, and the force out of balance, relative to those at work."""
        raise NotImplementedError

    def settle(self, tolerance: float = 1e-10, steps: int = 100) -> float:
        """Repeat the step at the load reached, time standing still, until equilibrium; returns what is left.

        A linear solve a step leaves an imbalance wherever the tangent is not the derivative of the force at the
        points (eq. 7 is not: about 0.45 of it is left each time).  ``tolerance`` (-): largest imbalance, relative to
        loads and internal force; ``steps``: how often at most.  Recorders are not called.  Raises ``RunError`` where
        that does not suffice, ``ValueError`` in dynamics.
        """
        self._at_rest("settle")
        tolerance, steps = positive("tolerance", tolerance), whole("steps", steps)
        found = [self.balance()[1]]
        while not found[-1] <= tolerance:
            if len(found) > steps:
                last = ", ".join(f"{value:.1e}" for value in found[-3:])
                raise RunError(f"{self.name}: out of balance by {last} after {steps} steps at t = {self.time:.6g}; "
                               f"allowed {tolerance:.1e}")
            with self.reported():
                self.advance(self.time, self.time)
            found.append(self.balance()[1])
        return found[-1]

    def reactions(self, *surfaces) -> list[Traction]:
        """What the fixed edges of a quasi-static run bear, as tractions on surfaces that take their place.

        ``surfaces``: all of them together (they share corners), surface points on the fixed grid lines or facets of
        a finite element run.  See ``reactions.tractions``; raises its ``ValueError`` and one in dynamics.
        """
        self._at_rest("reactions")
        return tractions(self.scene, self.equilibrium.fixed, self.balance()[0], surfaces)

    def _at_rest(self, name: str) -> None:
        if self.stepping.dynamic:
            raise ValueError(f"{name} needs a quasi-static run, got {self.stepping}")

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
