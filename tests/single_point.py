"""One point on a path: some strains are given, the stresses of the others are held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mpm_fenicsx.materials.material import NOTHING, Given


@dataclass
class Path:
    """Total strain (steps + 1, components), stress, Pa, and state variables along it."""

    strain: np.ndarray
    stress: np.ndarray
    history: np.ndarray


def drive(
    law,
    strain,
    steps: int = 1,
    free=(),
    start=None,
    target=None,
    history=None,
    given: Given = NOTHING,
    tolerance: float = 1e-12,
) -> Path:
    """Go to ``strain`` (components,) in equal steps.

    The strains of the components ``free`` are found instead, such that their stress goes in equal
    steps from that of the ``start`` (components,) to that of ``target``, which is the start if
    there is none.  Raises ``AssertionError`` where Newton's method finds none.
    """
    strain, free = np.asarray(strain, float), list(free)
    start = np.zeros(len(strain)) if start is None else np.asarray(start, float)
    target = start if target is None else np.asarray(target, float)
    stress = start[None].copy()
    state = law.initial_history(stress, given) if history is None else np.array(history, float)
    rows = [(np.zeros(len(strain)), stress[0], state[0])]
    increment = strain[None] / steps
    increment[:, free] = 0.0
    for step in range(1, steps + 1):
        want = start + (target - start) * (step / steps)
        increment = increment.copy()
        for _ in range(50):
            new, after, tangent = law.tangent(increment, stress, state, given)
            off = (want - new[0])[free]
            if np.abs(off).max(initial=0.0) <= tolerance * np.abs(new).max():
                break
            block = tangent[0][np.ix_(free, free)]
            increment[0, free] += np.linalg.lstsq(block, off, rcond=1e-12)[0]
        else:
            raise AssertionError(f"step {step}: stress is off by {off} Pa")
        stress, state = new, after
        rows.append((rows[-1][0] + increment[0], stress[0], state[0]))
    return Path(*(np.array(column) for column in zip(*rows, strict=True)))
