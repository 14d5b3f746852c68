"""Rest: what a quasi-static run can be asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common.checks import positive, whole
from ..common.errors import RunError
from ..common.ranks import warn
from ..solver.rigid_motions import free_motion
from ..terms.loads import Traction
from .reactions import tractions

STALL, ALIKE = 50, 0.01
"""So many steps whose least and most imbalance are those of as many before, to that part, bring no
progress: more of them do not either."""
OUT_OF_BALANCE = 1e-5
"""Relative to the forces at work: with more reactions are not those at rest."""


class Statics:
    """Equilibrium at the load reached, and what supports bear there."""

    _supported = False

    def balance(self) -> tuple[np.ndarray, float]:
        """The load that supports hold as things stand (dofs,), N, downwards under a weight, and the
        force out of balance, relative to those at work; in dynamics the latter is what accelerates.

        Forces on light nodes count where their ties hand them to (see ``ties``): what a sliver of a
        cell lacks of balance weighs nothing.  ``strict_imbalance`` is the same figure with every
        node on its own.
        """
        raise NotImplementedError

    @property
    def strict_imbalance(self) -> float:
        """What was out of balance when ``balance`` was last asked, with every node on its own."""
        return self.equilibrium.strict

    def filled_cells(self) -> np.ndarray:
        """Which cells hold material (cells,), bool."""
        raise NotImplementedError

    def check_supports(self) -> None:
        """Refuse a quasi-static run with a rigid motion that is free, before its first step:
        ``ValueError``."""
        if self.stepping.dynamic or self._supported:
            return
        if any(contribution.holds for contribution in self.scene.contributions):
            self._supported = True
            return
        message = free_motion(
            self.grid, self.filled_cells(), self.equilibrium.fixed, self.scene.sides
        )
        if message:
            raise ValueError(
                f"terms: {message}; a quasi-static run needs Fixed on facets of the grid that the "
                "material touches"
            )
        self._supported = True

    def settle(self, tolerance: float = 1e-10, steps: int = 1000) -> float:
        """Repeat the step at the load reached, time standing still, until equilibrium; returns what
        is left.

        A linear solve a step leaves an imbalance wherever the tangent is not the derivative of the
        force at the points (eq. 7 is not: about 0.45 of it is left each time).  ``tolerance`` (-):
        largest imbalance of ``balance``, relative to loads and internal force; ``steps``: how often
        at most.  Recorders are not called.
        Raises ``RunError`` where that does not suffice, or the last 50 steps made no progress;
        ``ValueError`` in dynamics and for what supports leave free.
        """
        self._at_rest("settle")
        self.check_supports()
        tolerance, steps = positive("tolerance", tolerance), whole("steps", steps)
        self.begin_once()
        found = [self.balance()[1]]
        while not found[-1] <= tolerance:
            stalls = _stalls(found)
            if stalls or len(found) > steps:
                last = ", ".join(f"{value:.1e}" for value in found[-3:])
                stuck = (
                    f"; no progress in the last {STALL} steps, as where a body ends a hair beyond "
                    "a grid line and GhostPenalty takes the place of ties: accept what is left by "
                    f"settle(tolerance={_above(max(found[-STALL:]))})"
                )
                raise RunError(
                    f"{self.name}: out of balance by {last} after {len(found) - 1} steps at t = "
                    f"{self.time:.6g}; allowed {tolerance:.1e}; {self.equilibrium.largest()}"
                    + (stuck if stalls else "")
                )
            with self.reported():
                self.advance(self.time, self.time)
            found.append(self.balance()[1])
        return found[-1]

    def reactions(self, *surfaces) -> list[Traction]:
        """What the fixed edges of a quasi-static run bear, as tractions on surfaces that take their
        place.

        ``surfaces``: all of them together (they share corners), surface points on the fixed grid
        lines or facets of a finite element run.  See ``reactions.tractions``; raises its
        ``ValueError`` and one in dynamics.
        """
        self._at_rest("reactions")
        equilibrium = self.equilibrium
        borne, left = self.balance()
        if left > OUT_OF_BALANCE:
            warn(
                self.grid.comm,
                f"reactions of a run that is out of balance by {left:.2g} of its forces: what they "
                "take the place of moves when it is set free; settle() first",
                2,
            )
        return tractions(self.scene, equilibrium.fixed, borne, surfaces, equilibrium.ties)

    def _at_rest(self, name: str) -> None:
        if self.stepping.dynamic:
            raise ValueError(f"{name} needs a quasi-static run, got {self.stepping}")


def _stalls(found: Sequence[float]) -> bool:
    """Whether imbalances (n,) of steps are those of the steps before."""
    if len(found) < 2 * STALL:
        return False
    before, now = found[-2 * STALL : -STALL], found[-STALL:]
    return all(abs(look(now) - look(before)) <= ALIKE * abs(look(before)) for look in (min, max))


def _above(value: float) -> str:
    """A number of one digit that is larger."""
    size = 10.0 ** np.floor(np.log10(value))
    return f"{np.ceil(1.05 * value / size) * size:.0e}"
