"""The root of a function of one number that is positive at zero and negative far out: Newton's
steps, kept in a bracket."""

from __future__ import annotations

import math

from ..common.compiled import jit

TRIES = 100


@jit
def next_guess(guess, value, slope, low, high):
    """Return the next guess and the bracket, after ``value`` and ``slope`` at ``guess``; the root
    lies between ``low`` and ``high``, which is infinite until a negative value is known."""
    if value > 0.0:
        low = guess
    else:
        high = guess
    step = guess - value / slope if slope < 0.0 else math.inf
    if low < step < high:
        return step, low, high
    if high == math.inf:
        return 2.0 * guess + value, low, high
    return 0.5 * (low + high), low, high
