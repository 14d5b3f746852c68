"""Rest: what a quasi-static run can be asked for."""

from __future__ import annotations

import numpy as np

from .checks import positive, whole
from .failure import RunError
from .reactions import tractions
from .terms import Traction


class Statics:
    """Equilibrium at the load reached, and what supports bear there."""

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
        self._begin_once()
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
