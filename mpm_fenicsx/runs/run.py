"""What a material point run and a finite element run share: time, recorders, and honest failure."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np
from dolfinx import fem

from ..common.checks import finite, one_of
from ..common.errors import OutputError, RunError, SolverError
from ..common.ranks import warn
from ..common.spread import Part, Spread
from ..dynamics.time_stepping import Newmark, QuasiStatic
from ..grid import dolfinx_versions
from ..grid.grid import Grid
from ..grid.stress_field import StressField
from ..output.checkpoint import restart
from .identity import described
from .redistribution import fields, misfit, part_of, rows_of_points
from .scene_checks import check_run, refuse_other_scenes, terms_of
from .statics import Statics

WHOLE = 1e-6
"""Of a step: so near to a whole number of steps is one, for times are sums and quotients of rounded
numbers."""


class Run(Statics):
    """Steps in time and calls recorders after each step."""

    bodies: Sequence = ()  # of material points, if any

    def __init__(self, name: str, grid: Grid, stepping: Newmark | QuasiStatic, terms: Sequence):
        check_run(grid, stepping)
        self.name, self.grid, self.terms = name, grid, terms_of(terms)
        words = ", ".join(type(term).__name__ for term in self.terms) or "no terms"
        many = len(self.bodies)
        refuse_other_scenes(grid.comm, (name, repr(stepping), f"{many} bodies", words))
        self._stepping = stepping
        self._clock = np.zeros(2)  # steps and time (s) at which the present step came into use
        self._begun = False
        self.steps = 0
        self.arrangement = 0  # another number where samples have other rows, or ranks
        self.recorders: list[Callable] = []
        self.collectors: list = []

    @property
    def stepping(self) -> Newmark | QuasiStatic:
        """The rule and the length of the step; ``change_step`` changes them."""
        return self._stepping

    @stepping.setter
    def stepping(self, value) -> None:
        raise AttributeError(
            f"stepping is not to be assigned, for time would jump: use run.change_step({value!r})"
        )

    def change_step(self, stepping: Newmark | QuasiStatic) -> None:
        """Go on with another step from the time reached; what the run remembers stays.

        Raises ``ValueError`` where inertia would come or go, or forces at the start of a step weigh
        otherwise (``GeneralizedAlpha.start``): that takes another run.
        """
        now = self.stepping
        if not isinstance(stepping, (Newmark, QuasiStatic)):
            raise ValueError(
                f"stepping must be a Newmark, GeneralizedAlpha or QuasiStatic, got {stepping!r}"
            )
        if (stepping.dynamic, stepping.start) != (now.dynamic, now.start):
            raise ValueError(
                f"stepping: a run with {now} cannot go on with {stepping}; make another run of its "
                "points"
            )
        self._clock[:] = self.steps, self.time
        self._stepping = stepping

    @property
    def time(self) -> float:
        """Time reached (s; load parameter when quasi-static)."""
        return self._time_of(self.steps)

    @property
    def next_time(self) -> float:
        """Time at the end of the step to come."""
        return self._time_of(self.steps + 1)

    def _time_of(self, steps: int) -> float:
        return float(self._clock[1] + (steps - self._clock[0]) * self.stepping.dt)

    def begin(self) -> None:
        """What is to be done once, before the first step."""

    def begin_once(self) -> None:
        """Do what is to be done before the first step, where that has not been done."""
        if not self._begun:
            self.begin()
            self._begun = True

    def step(self) -> None:
        """One step of length ``stepping.dt``.

        Raises ``RunError`` naming step and time; what is recorded stays, and the state is that of
        the last whole step. ``ValueError`` before the first quasi-static step where supports leave
        a rigid motion free.
        """
        self.check_supports()
        with self.reported():
            self.begin_once()
            self.advance(self.time, self.next_time)
        self.finish()

    def attempt(self, start: float, end: float, stepping: Newmark | QuasiStatic) -> None:
        """Solve for the motion from ``start`` to ``end`` (s), and move nothing yet."""
        raise NotImplementedError

    def iterate(self, internal: np.ndarray | None) -> None:
        """Go on from the first solve, where the response is not linear; ``internal`` (dofs,), N, as
        in ``Equilibrium.solve``."""
        if self.yielding is not None:
            self.solver.newton.iterate(self.equilibrium, internal, self.equilibrium.first)

    def carry(self) -> None:
        """Make the motion that was solved for the state; refuse it before anything has changed."""
        raise NotImplementedError

    def advance(self, start: float, end: float, cut: int = 0) -> None:
        """From ``start`` to ``end`` (s); a step that cannot be solved is halved, Newton's ``cuts``
        times."""
        try:
            self.attempt(start, end, self.stepping.part(0.5**cut))
        except SolverError as error:
            if self.yielding is None or (cut == self.solver.newton.cuts == 0):
                raise
            if cut == self.solver.newton.cuts:
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
        """Take the state back, if ``wanted``, where something goes wrong inside: the parts of a
        step go together."""
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

    def numbers_of(self, field: str, rows: np.ndarray) -> np.ndarray | None:
        """Numbers (m, k) that samples of a field keep wherever they go; None where they stay."""
        return None

    def rows_of(self, field: str, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows (k,) of those samples of ``numbers`` that are on this rank now, and which (k,) of
        them these are."""
        raise NotImplementedError

    def holds(self, at: np.ndarray) -> bool:
        """Whether a place (dim,), m, lies inside this rank's part of the body."""
        raise NotImplementedError

    def energy(self) -> dict[str, float]:
        """Kinetic and strain energy (J) of this rank's part of the body."""
        raise NotImplementedError

    def stress_field(self) -> StressField:
        """The stress on the grid as it is now."""
        raise NotImplementedError

    def nodal(self, field: str) -> np.ndarray:
        """Nodal values (nodes, dim) that the run works with, to be read or set: "increment" (m) of
        the last step; in dynamics "velocity" (m/s) and "acceleration" (m/s²) before it.  In a
        finite element run velocity and acceleration are those after it, and "displacement" (m) is
        that from the configuration at rest."""
        known = self._nodal_fields()
        return self.motion.nodal(known[one_of("field", field, known)])

    def _nodal_fields(self) -> dict[str, fem.Function]:
        """Vector fields on the grid's nodes, by name."""
        motion = self.motion
        known = {"increment": motion.u}
        if self.stepping.dynamic:
            known.update(velocity=motion.v, acceleration=motion.a)
        return known

    @property
    def solves(self) -> int:
        """Linear solves so far."""
        return self.equilibrium.solves

    @property
    def iterations(self) -> int:
        """Iterations of the last linear solve."""
        return self.equilibrium.iterations

    @property
    def rescues(self) -> int:
        """How often so far the iterative solver has failed and a factor of the matrix has solved
        in its place."""
        return self.equilibrium.rescues

    def term_energies(self) -> dict[str, object]:
        """Forms of what terms do to the energy in a step (J), by name."""
        forms: dict[str, object] = {}
        for contribution in self.scene.contributions:
            for name, form in contribution.energies().items():
                forms[name] = forms.get(name, 0) + form
        return forms

    def record(self, recorder):
        """Attach a recorder: called after each step, and once now for the start.  Returns it.

        One that has ``state()``, arrays by name, and ``restore(state)`` goes on with its record
        after ``restart``.
        Raises ``OutputError`` where it cannot write.
        """
        such_as = "recorder must be an object such as Energy() or Probe(field, at)"
        if isinstance(recorder, type):
            raise ValueError(f"{such_as}, got {recorder!r}: call it with what it asks for")
        lacking = "" if callable(recorder) else "__call__(run)"
        lacking = lacking if hasattr(recorder, "attach") else "attach(run)"
        if lacking:
            raise ValueError(f"{such_as}, and this has no {lacking}, got {recorder!r}")
        if any(one is recorder for one in self.recorders):
            raise ValueError(f"recorder: this run has it already, {recorder!r}")
        try:
            recorder.attach(self)
        except OSError as error:
            raise self._not_written(error) from error
        self.recorders.append(recorder)
        if hasattr(recorder, "collect"):
            self.collectors.append(recorder)
        self.recorders.sort(key=lambda r: getattr(r, "last", False))
        return recorder

    def state(self) -> dict[str, np.ndarray]:
        """The arrays, by name, that the next step depends on: those the run works with, not
        copies."""
        return {
            "clock": self._clock,
            "solver": self.equilibrium.memory,
            **{f"motion/{name}": value for name, value in self.motion.state().items()},
            **self.scene.state(),
        }

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take the values of ``state`` in place of the present ones."""
        for name, value in self.state().items():
            value[...] = state[name]

    def arrays_that_move(self) -> set[str]:
        """Names in ``state`` of arrays whose rows may be on another rank at another time."""
        return set()

    def spread(self) -> dict[str, Spread]:
        """How the arrays of ``state`` lie on the ranks."""
        motion = {f"motion/{name}": Spread.NODES for name in self.motion.state()}
        alike = {"clock": Spread.ALIKE, "solver": Spread.ALIKE}
        return {**alike, **motion, **self.scene.spread()}

    def part(self) -> Part:
        """This rank's part of the state.  Collective."""
        return part_of(self.grid, self.state())

    def lie_as(self, parts: Sequence[Part]) -> None:
        """Where the grid can be divided anew, divide it as it was where the parts come from."""

    def misfit(self, parts: Sequence[Part]) -> str | None:
        """Why parts of a state on other ranks cannot become this run's, or None.  Collective."""
        return misfit(self.grid, parts, self.spread())

    def receive(self, parts: Sequence[Part]) -> None:
        """Take the state that lay on other ranks, of which each rank now holds some parts.
        Collective."""
        self.put(parts, self.points_of(parts))

    def points_of(self, parts: Sequence[Part]) -> dict[str, dict[str, np.ndarray]]:
        """Arrays of the points that belong on this rank, by the names of ``clouds``.
        Collective."""
        return {
            cloud: rows_of_points(self.grid, parts, cloud, per_face)
            for cloud, per_face in self.clouds().items()
        }

    def put(self, parts: Sequence[Part], points: Mapping[str, dict[str, np.ndarray]]) -> None:
        """Take fields from parts of a state, and ``points`` that are here.  Collective."""
        state = self.state()
        for name, value in fields(self.grid, parts, state, self.spread()).items():
            state[name][...] = value
        for cloud, arrays in points.items():
            self.take_points(cloud, arrays)
        self.arrangement += 1

    def clouds(self) -> dict[str, int]:
        """Points whose arrays are in ``state`` below these names, and how many of them in a row are
        one face."""
        return self.scene.clouds()

    def take_points(self, cloud: str, arrays: dict[str, np.ndarray]) -> None:
        """Points become those of other arrays, by the names of ``state`` below theirs."""
        self.scene.take_points(cloud, arrays)

    def partition(self) -> np.ndarray:
        """A number (1,) that is another where this rank's cells and nodes, or their order, are
        other ones."""
        grid = self.grid
        nodes = zlib.crc32(np.ascontiguousarray(grid.space.tabulate_dof_coordinates()))
        return np.array(
            [zlib.crc32(np.ascontiguousarray(dolfinx_versions.cell_dofs(grid.space)), nodes)]
        )

    def identity(self) -> dict[str, str]:
        """What a checkpoint's run must have in common with this one, in words.  Collective."""
        grid = self.grid
        return {
            "run": self.name,
            "stepping": repr(self.stepping),
            "grid": f"{grid.mesh.topology.index_map(grid.dim).size_global} cells in {grid.dim}D, "
            f"{grid.space.dofmap.index_map.size_global} nodes, places {_places(grid):016x}",
            "terms": ", ".join(type(term).__name__ for term in self.terms),
            **{
                f"term {n}, {type(term).__name__}": described(term)
                for n, term in enumerate(self.terms)
            },
        }

    def restart(self, path: str | os.PathLike) -> None:
        """Go on from the step of a checkpoint, bit for bit as the run that wrote it.

        On more or fewer ranks it is the same run but for round-off.  Call it on a run that the same
        script has built anew, its recorders attached, or on one that has failed. What recorders
        there have recorded is replaced; those of the file that this run has not are left out, and
        what is recorded from here on is recorded after this call.
        The mapping's transfer, Newton's limits and solver may be others.
        Raises ``ValueError`` naming what differs, and then has changed nothing; ``OSError`` for a
        file that cannot be read or is no checkpoint.
        """
        restart(self, path)

    def resume(self, steps: int) -> None:
        """The state is that after so many steps."""
        self.steps, self._begun = steps, steps > 0

    def until(self, t: float, progress: Callable[[int], None] | None = None) -> None:
        """Step until time ``t`` (s); ``progress`` is called with the number of steps done.

        Where ``t`` is no whole number of steps away, it stops at the nearest one and warns.  Raises
        ``ValueError`` for a ``t`` that is past.
        """
        if progress is not None and not callable(progress):
            raise ValueError(
                f"progress must be a function of the number of steps, got {progress!r}"
            )
        left = (finite("t", t) - self.time) / self.stepping.dt
        if left < -WHOLE:
            raise ValueError(
                f"t must not be past, {self.name} has come to t = {self.time:.6g}, got {t}"
            )
        last = self.steps + round(left)
        if abs(left - round(left)) > WHOLE:
            stop = self.time + round(left) * self.stepping.dt
            warn(
                self.grid.comm,
                f"until({t}) stops at t = {stop:.6g}: from t = {self.time:.6g} it is no whole "
                f"number of steps of {self.stepping.dt:.6g}",
                2,
            )
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
        """After each solve, of which a step can need several: what adds up over time is added
        up."""
        for collector in self.collectors:
            collector.collect(self)

    @contextmanager
    def reported(self) -> Iterator[None]:
        """Name step and time in whatever goes wrong inside a step."""
        try:
            yield
        except (SolverError, RunError, ValueError, FloatingPointError) as error:
            raise RunError(
                f"{self.name}, step {self.steps + 1}, t = {self.next_time:.6g}: {error}"
            ) from error


def _places(grid: Grid) -> int:
    """A number that is another where nodes lie elsewhere, whatever ranks they are on."""
    geometry = grid.mesh.geometry
    owned = geometry.index_map().size_local
    x = grid.made_at[:owned] + 0.0  # -0 is 0
    mixed = np.zeros(owned, np.uint64)
    for bits in np.ascontiguousarray(x.T).view(np.uint64):
        mixed = (mixed ^ bits) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    return grid.comm.allreduce(int(mixed.sum(dtype=np.uint64))) % 2**64
