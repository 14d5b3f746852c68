"""Bodies that meet, push one another, and part: a run of several runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import combinations
from typing import NoReturn

import numpy as np

from ..common.errors import OutputError, SolverError
from ..common.spread import Part
from ..dynamics.time_stepping import Newmark, QuasiStatic
from ..points.surface_points import SurfacePoints
from ..runs.material_points import Simulation
from ..runs.redistribution import part_of
from ..runs.run import Run
from ..runs.scene_checks import pairs_of
from .complementarity import complementary
from .gaps import Gaps
from .impact import nodal_mass, stop

TOLERANCE, YIELDING, ROUNDS = 1e-8, 1e-6, 20
"""What gaps may be wrong by, of the deepest that bodies would go into one another in the step; the
same where bodies yield, and how often motion and forces are then found in turns."""

LIGHT, HAIR, OVERLAP = 1e-6, 1e-12, 1e-6
"""Of the heaviest node: what weighs less bears no contact, for it would be thrown away without a
word from the body; of the smallest cell: a gap that is none; of a face: overlap of bodies at the
start that is none."""


class Contact(Run):
    """Bodies on one grid, each a run with a motion of its own, that may touch: smooth, unilateral,
    implicit.

    ``bodies``: two or more pairs of a Simulation and the SurfacePoints of it that may touch
    others'.  After each has been solved alone, forces λ >= 0 between points of the surface named
    first and faces of the other keep the gaps at the end of the step from closing (see
    ``Touching``),

        gap + n·(u_a − u_b) >= 0,   λ >= 0,   λ (gap + n·(u_a − u_b)) = 0,   K u = r ± Σ n λ

    and act on both bodies alike: momentum is exact, and bodies that do not touch, or part, feel
    nothing.  The smaller or finer of two surfaces comes first.  In statics each body needs supports
    of its own. ``forces`` (bodies, dim), N: of the others on each body, whose sum over steps is the
    impulse.  In dynamics those of a body that comes to rest chatter between nothing and some three
    times its weight, for it leaves and lands again; their mean over 100 steps was the weight within
    1 %: read means. Recorders may look at the bodies' runs or, but for Energy, at this one; a
    checkpoint is this one's.
    Raises ``ValueError`` for runs that cannot go together.
    """

    def __init__(self, *bodies: tuple[Simulation, SurfacePoints]):
        bodies = pairs_of(bodies, Simulation, SurfacePoints)
        runs = self.runs = [run for run, _ in bodies]
        first = runs[0]
        if any(a is b for a, b in combinations(runs, 2)):
            raise ValueError("bodies: a run is named twice; give it one surface of several sides")
        for run in runs:
            if run.grid is not first.grid:
                raise ValueError("bodies: all runs need one grid")
            if run.stepping != first.stepping:
                raise ValueError(
                    f"bodies: all runs need one stepping, got {first.stepping} and {run.stepping}"
                )
            if run.removal is not None:
                raise ValueError(
                    "bodies: on_exit=REMOVE is not for runs of a Contact: leave it out"
                )
        if first.grid.comm.size > 1:
            raise ValueError(
                f"Contact runs on one rank, and here are {first.grid.comm.size}: start it without "
                "mpiexec"
            )
        super().__init__(
            first.name, first.grid, first.stepping, [term for run in runs for term in run.terms]
        )
        patches = [run.scene.patch(surface) for run, surface in bodies]
        self.gaps = Gaps(patches)
        can = next((run for run in runs if run.yielding is not None), first)
        self.yielding, self.equilibrium, self.solver = can.yielding, can.equilibrium, can.solver
        self.forces = np.zeros((len(runs), self.grid.dim))
        self.bodies = [body for run in runs for body in run.bodies]
        self._hair = HAIR * (first.grid.lattice.upper - first.grid.lattice.lower).min()
        self._refuse_overlap(patches)

    # -- the step ----------------------------------------------------------------------------------

    def begin(self) -> None:
        """Before the first step: each body alone."""
        for run in self.runs:
            run.begin()

    def change_step(self, stepping: Newmark | QuasiStatic) -> None:
        """Go on with another step, all bodies."""
        super().change_step(stepping)
        for run in self.runs:
            run.change_step(stepping)

    def attempt(self, start: float, end: float, stepping: Newmark | QuasiStatic) -> None:
        """Solve each body's motion alone, then for the forces between them."""
        for run in self.runs:
            run.attempt(start, end, stepping)
        self._masses = [nodal_mass(run) for run in self.runs]
        bare = [
            run.equilibrium.idle.reshape(-1, self.grid.dim).any(axis=1)
            | (mass[:, 0] <= LIGHT * mass.max())
            for run, mass in zip(self.runs, self._masses, strict=True)
        ]
        self.gaps.find()
        self.gaps.weigh(bare)
        self._hold_apart()

    def check_supports(self) -> None:
        """In statics each body needs supports of its own."""
        for run in self.runs:
            run.check_supports()

    def carry(self) -> None:
        """All bodies move, or none."""
        with self.all_or_nothing(True):
            for run in self.runs:
                run.carry()
            stepping = self.runs[0].motion.stepping
            self.forces = self.gaps.resultants(
                stop(self.runs, self.gaps, self._masses, stepping)
                if stepping.dynamic
                else self.gaps.λ
            )
            self.collect()

    @contextmanager
    def all_or_nothing(self, wanted: bool) -> Iterator[None]:
        """Take the state back, and the runs' sums, if ``wanted``, where something goes wrong
        inside."""
        with ExitStack() as stack:
            for run in self.runs:
                stack.enter_context(run.all_or_nothing(wanted))
            yield stack.enter_context(super().all_or_nothing(wanted))

    def finish(self) -> None:
        """End of a step, for the bodies' runs as well."""
        failure = None
        for finish in (*(run.finish for run in self.runs), super().finish):
            try:
                finish()
            except OutputError as error:
                failure = failure or error
        if failure is not None:
            raise failure

    def _hold_apart(self) -> None:
        """Forces between the bodies, and what they add to the motion that each would have alone."""
        gap = self._gap()
        deepest = -gap.min(initial=0.0)
        if deepest <= self._hair:
            return self.gaps.keep(np.zeros_like(gap))
        allowed, λ = max(TOLERANCE * deepest, self._hair) * np.sqrt(len(gap)), self.gaps.λ
        if self.yielding is None:
            λ = complementary(self._compliance, gap, λ, allowed)
            for run, force in zip(self.runs, self.gaps.forces(λ), strict=True):
                run.motion.u.x.array[:] += _response(run, force).ravel()
            return self.gaps.keep(λ)
        before, wrong, enough = np.zeros_like(λ), [deepest], max(YIELDING * deepest, self._hair)
        while not wrong[-1] <= enough:
            if len(wrong) > ROUNDS:
                raise SolverError(
                    f"contact: forces and yielding do not settle, gaps wrong by {wrong[-3:]} m; "
                    f"allowed {enough:.3g}"
                )
            λ = complementary(self._compliance, gap - self._compliance(before), λ, allowed)
            for run, force in zip(self.runs, self.gaps.forces(λ), strict=True):
                run.solve(force.ravel())
            gap, before = self._gap(), λ
            wrong.append(np.abs(np.where(λ > 0.0, gap, np.minimum(gap, 0.0))).max())
        self.gaps.keep(λ)

    def _gap(self) -> np.ndarray:
        """Gaps (m,), m, at the end of the step, with the motions as they are."""
        return self.gaps.start + self.gaps.opening(
            [run.motion.nodal(run.motion.u) for run in self.runs]
        )

    def _compliance(self, λ: np.ndarray) -> np.ndarray:
        """What forces λ (m,), N, open the gaps by (m,), m."""
        return self.gaps.opening(
            [
                _response(run, force)
                for run, force in zip(self.runs, self.gaps.forces(λ), strict=True)
            ]
        )

    def _refuse_overlap(self, patches: list) -> None:
        for patch in patches:
            patch.prepare(self.time, self.time)
        self.gaps.find()
        for a, b, pair in self.gaps.pairs:
            size = patches[b].points.area.min() ** (1.0 / (self.grid.dim - 1))
            if pair.gap.min(initial=0.0) < -OVERLAP * size:
                raise ValueError(f"bodies {a} and {b} overlap by {-pair.gap.min():.3g} m")

    # -- what contact cannot be asked for ----------------------------------------------------------

    def balance(self) -> tuple[np.ndarray, float]:
        """Raises ``ValueError``: nodes of a grid that bodies share are each body's own."""
        raise ValueError(
            "balance is of one body: ask each of the runs that Contact was given, run.balance(); "
            "the forces between bodies are in Contact.forces"
        )

    def settle(self, tolerance: float = 1e-10, steps: int = 100) -> float:
        """Raises ``ValueError``: bodies come to rest apart, each in a run of its own, before they
        meet."""
        raise ValueError(
            "settle is of one body: settle each body in a QuasiStatic run of its own, with the "
            "weight of what rests on it as a Traction, then let them meet; or add steps of the "
            "QuasiStatic contact"
        )

    def reactions(self, *surfaces) -> list:
        """Raises ``ValueError``: supports are those of one body."""
        raise ValueError(
            "reactions are of one body: ask each of the runs that Contact was given, "
            "run.reactions(*surfaces)"
        )

    # -- what Run and recorders ask for ------------------------------------------------------------

    def state(self) -> dict[str, np.ndarray]:
        """What the next step depends on, by name; not copied."""
        found = {
            f"runs/{k}/{name}": value
            for k, run in enumerate(self.runs)
            for name, value in run.state().items()
        }
        return {
            "clock": self._clock,
            **found,
            **{f"contact/{name}": λ for name, λ in self.gaps.state().items()},
        }

    def part(self) -> Part:
        """The state of all runs."""
        return part_of(self.grid, self.state())

    def misfit(self, parts: Sequence[Part]) -> str:
        """Other ranks, or nodes in another order, cannot go on with bodies that may touch."""
        return "contact goes on on one rank, with the grid's nodes in the order they had"

    def identity(self) -> dict[str, str]:
        """What a checkpoint's run must have in common with this one."""
        found = {
            f"run {k}, {name}": word
            for k, run in enumerate(self.runs)
            for name, word in run.identity().items()
        }
        return {**super().identity(), **found}

    def restart(self, path: str | os.PathLike) -> None:
        """Go on from the step of a checkpoint; recorders on the bodies' own runs are not part of
        it."""
        super().restart(path)
        for run in self.runs:
            run.resume(self.steps)

    def sampler(self, field: str) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
        """Places (n, dim) of all runs' points, one run after the other, and their values."""
        places, reads = zip(*(run.sampler(field) for run in self.runs), strict=True)
        return np.concatenate(places), lambda rows: np.concatenate(
            [read(np.arange(len(place))) for place, read in zip(places, reads, strict=True)]
        )[rows]

    def holds(self, at: np.ndarray) -> bool:
        """Whether a place (dim,), m, lies in one of the bodies."""
        return any(run.holds(at) for run in self.runs)

    def term_energies(self) -> dict[str, object]:
        """Raises ``ValueError``: forms are integrals over one body each."""
        raise ValueError("Energy is of one body: record it on each of the runs")

    def nodal(self, field: str) -> NoReturn:
        """Raises ``ValueError``: nodes move with each body in its own way."""
        raise ValueError(
            f"nodal {field} is of one body: ask each of the runs that Contact was given"
        )

    def stress_field(self) -> NoReturn:
        """Raises ``ValueError``: bodies that meet in a cell have stresses of their own."""
        raise ValueError(
            "stress on the grid is of one body: ask each of the runs that Contact was given"
        )

    def energy(self) -> dict[str, float]:
        """Energy of the bodies (J), by kind."""
        found: dict[str, float] = {}
        for run in self.runs:
            for name, value in run.energy().items():
                found[name] = found.get(name, 0.0) + value
        return found

    def grid_fields(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Those of the bodies' runs, by number."""
        fields = [run.grid_fields() for run in self.runs]
        return tuple(
            {
                f"{name}_{k}": value
                for k, both in enumerate(fields)
                for name, value in both[i].items()
            }
            for i in range(2)
        )


def _response(run: Simulation, force: np.ndarray) -> np.ndarray:
    """K⁻¹ of nodal forces (nodes, dim), N, which leaves the run's motion as it is."""
    equilibrium = run.equilibrium
    if not force.any():
        return force
    r, u = equilibrium.force.x.array, run.motion.u.x.array
    r[:] = force.ravel()
    r[equilibrium.fixed] = 0.0
    kept = u.copy()
    equilibrium.correct()
    u[:] = kept
    return equilibrium.increment.x.array.reshape(force.shape).copy()
