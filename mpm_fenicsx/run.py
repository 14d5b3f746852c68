"""What a material point run and a finite element run share: time, recorders, and honest failure."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from . import fenicsx
from .checkpoint import restart
from .checks import finite
from .failure import OutputError, RunError
from .grid import Grid
from .newton import SolverError
from .statics import Statics
from .time_stepping import Newmark, QuasiStatic

FIELDS = ("displacement", "velocity", "acceleration", "stress")


class Run(Statics):
    """Steps in time and calls recorders after each step."""

    def __init__(self, name: str, grid: Grid, stepping: Newmark | QuasiStatic, terms: Sequence):
        self.name, self.grid, self.stepping, self.terms = name, grid, stepping, list(terms)
        self.steps = 0
        self.recorders: list[Callable] = []
        self.collectors: list = []

    @property
    def time(self) -> float:
        """Time reached (s; load parameter when quasi-static)."""
        return self.steps * self.stepping.dt

    @property
    def next_time(self) -> float:
        """Time at the end of the step to come."""
        return (self.steps + 1) * self.stepping.dt

    def step(self) -> None:
        """One step of length ``stepping.dt``.

        Raises ``RunError`` naming step and time; what is recorded stays, and the state is that of the last whole step.
        ``ValueError`` before the first quasi-static step where supports leave a rigid motion free.
        """
        self.check_supports()
        with self.reported():
            self.advance(self.time, self.next_time)
        self.finish()

    def attempt(self, start: float, end: float, stepping: Newmark | QuasiStatic) -> None:
        """Solve for the motion from ``start`` to ``end`` (s), and move nothing yet."""
        raise NotImplementedError

    def carry(self) -> None:
        """Make the motion that was solved for the state; refuse it before anything has changed."""
        raise NotImplementedError

    def advance(self, start: float, end: float, cut: int = 0) -> None:
        """From ``start`` to ``end`` (s); a step that cannot be solved is halved, Newton's ``cuts`` times."""
        try:
            self.attempt(start, end, self.stepping.part(0.5**cut))
        except SolverError as error:
            if self.yielding is None or (cut == self.equilibrium.newton.cuts == 0):
                raise
            if cut == self.equilibrium.newton.cuts:
                halved = f"from t = {start:.6g} to {end:.6g}, the step halved {cut} times"
                raise SolverError(f"{error}; {halved}") from error
        else:
            return self.carry()
        middle = 0.5 * (start + end)
        with self.all_or_nothing(cut == 0):
            self.advance(start, middle, cut + 1)
            self.advance(middle, end, cut + 1)

    @contextmanager
    def all_or_nothing(self, wanted: bool) -> Iterator[None]:
        """Take the state back, if ``wanted``, where something goes wrong inside: the parts of a step go together."""
        kept = {name: value.copy() for name, value in self.state().items()} if wanted else {}
        sums = [collector.sums.copy() for collector in self.collectors] if wanted else []
        try:
            yield
        except BaseException:
            if wanted:
                self.restore(kept)
            for collector, value in zip(self.collectors, sums, strict=wanted):
                collector.sums[:] = value
            raise

    def sampler(self, field: str) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
        """Places (n, dim) where the run knows a field, and a function from rows to values there."""
        raise NotImplementedError

    def energy(self) -> dict[str, float]:
        """Kinetic and strain energy (J) of this rank's part of the body."""
        raise NotImplementedError

    def record(self, recorder):
        """Attach a recorder: called after each step, and once now for the start.  Returns it.

        One that has ``state()``, arrays by name, and ``restore(state)`` goes on with its record after ``restart``.
        Raises ``OutputError`` where it cannot write.
        """
        try:
            recorder.attach(self)
        except OSError as error:
            raise self._not_written(error) from error
        self.recorders.append(recorder)
        self.recorders.sort(key=lambda r: getattr(r, "last", False))
        return recorder

    def state(self) -> dict[str, np.ndarray]:
        """The arrays, by name, that the next step depends on: those the run works with, not copies."""
        surfaces = {f"surfaces/{k}/{name}": value for k, patch in enumerate(self.scene.patches.values())
                    for name, value in patch.state().items()}
        return {**{f"motion/{name}": value for name, value in self.motion.state().items()}, **surfaces}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take the values of ``state`` in place of the present ones."""
        for name, value in self.state().items():
            value[...] = state[name]

    def identity(self) -> dict[str, str]:
        """What a checkpoint's run must have in common with this one, in words."""
        grid = self.grid
        nodes = zlib.crc32(np.ascontiguousarray(grid.space.tabulate_dof_coordinates()))
        order = zlib.crc32(np.ascontiguousarray(fenicsx.cell_dofs(grid.space)), nodes)
        return {"run": self.name, "stepping": repr(self.stepping),
                "grid": f"{grid.cells} cells in {grid.dim}D, {grid.nodes} nodes, places and order {order:08x}",
                "terms": ", ".join(type(term).__name__ for term in self.terms)}

    def restart(self, path: str | os.PathLike) -> None:
        """Go on from the step of a checkpoint, bit for bit as the run that wrote it.

        Call it on a run that the same script has built anew, its recorders attached, or on one that has failed.
        What recorders there have recorded is replaced; those of the file that this run has not are left out, and what
        is recorded from here on is recorded after this call.  Transfer, Newton's limits and solver may be others.
        Raises ``ValueError`` naming what differs, and then has changed nothing; ``OSError`` for a file that cannot be
        read or is no checkpoint.
        """
        restart(self, path)

    def until(self, t: float, progress: Callable[[int], None] | None = None) -> None:
        """Step until time ``t`` (s); ``progress`` is called with the number of steps done."""
        last = round(finite("t", t) / self.stepping.dt)
        while self.steps < last:
            self.step()
            if progress is not None:
                progress(self.steps)

    def finish(self) -> None:
        """End of a step: time goes on, recorders look, all of them even where one cannot write."""
        self.steps += 1
        failure = None
        for recorder in self.recorders:
            try:
                recorder(self)
            except OSError as error:
                failure = failure or error
        if failure is not None:
            raise self._not_written(failure) from failure

    def _not_written(self, error: OSError) -> OutputError:
        where = f"{self.name}, step {self.steps}, t = {self.time:.6g}"
        if error.errno is None:
            return OutputError(f"{where}: {error}")
        return OutputError(error.errno, f"{where}: {error.strerror}", error.filename)

    def collect(self) -> None:
        """After each solve, of which a step can need several: what adds up over time is added up."""
        for collector in self.collectors:
            collector.collect(self)

    @contextmanager
    def reported(self) -> Iterator[None]:
        """Name step and time in whatever goes wrong inside a step."""
        try:
            yield
        except (SolverError, RunError, ValueError, FloatingPointError) as error:
            raise RunError(f"{self.name}, step {self.steps + 1}, t = {self.next_time:.6g}: {error}") from error
