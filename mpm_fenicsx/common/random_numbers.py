"""Random numbers by number: each follows from a seed and its own number alone, in whatever order it
is asked for."""

from __future__ import annotations

import numpy as np

GOLDEN = 0x9E3779B97F4A7C15  # 2⁶⁴ over the golden ratio, odd
FIRST, SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
BITS = 1 << 64


def uniform(seed: int, number: np.ndarray, columns: int) -> np.ndarray:
    """Random numbers (n, columns), evenly spread over [0, 1), that belong to ``number`` (n,), whole
    and >= 0.

    Entry (number, column) is draw number · columns + column of SplitMix64 (Steele, Lea and Flood,
    Fast splittable pseudorandom number generators, OOPSLA 2014), which starts where ``seed`` leads.
    """
    start = int(_mixed(np.array([seed % BITS], dtype=np.uint64))[0])
    draw = np.asarray(number, dtype=np.uint64)[:, None] * np.uint64(columns) + np.arange(
        columns, dtype=np.uint64
    )
    state = np.uint64((start + GOLDEN) % BITS) + draw * np.uint64(GOLDEN)  # modulo 2⁶⁴
    return (_mixed(state) >> np.uint64(11)) * 2.0**-53


def _mixed(z: np.ndarray) -> np.ndarray:
    """Every bit of z (…,), uint64, spread over all bits."""
    z = (z ^ (z >> np.uint64(30))) * FIRST
    z = (z ^ (z >> np.uint64(27))) * SECOND
    return z ^ (z >> np.uint64(31))
