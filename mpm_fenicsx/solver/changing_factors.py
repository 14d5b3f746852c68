"""Whether what terms have made of the matrix has changed since it was assembled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx import fem

from ..dynamics.motion import Motion
from ..grid.form_degree import factors
from ..terms.contribution import Contribution


class ChangingFactors:
    """Coefficients that multiply u in the work of terms with hooks, which may change them.

    Where finite elements keep their matrix, and where ``reuse`` keeps parts of it, it is assembled
    anew when one of them has another value.
    """

    def __init__(self, motion: Motion, contributions: Sequence[Contribution]):
        self._comm = motion.grid.comm
        hooked = [c.work for c in contributions if (c.before or c.after) and c.work]
        found = [one for work in hooked for one in factors(work, motion.u)]
        self._factors = list(dict.fromkeys(found))
        self._known: list[np.ndarray] | None = None

    def changed(self) -> bool:
        """Whether one has another value than when this was last asked; at first none has.
        Collective."""
        if not self._factors:
            return False
        now = [_value(one).copy() for one in self._factors]
        before, self._known = self._known, now
        other = before is not None and any(
            not np.array_equal(a, b) for a, b in zip(before, now, strict=True)
        )
        return bool(self._comm.allreduce(int(other)))


def _value(factor: fem.Function | fem.Constant) -> np.ndarray:
    return factor.x.array if isinstance(factor, fem.Function) else np.asarray(factor.value)
