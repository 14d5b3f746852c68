"""Trial calls of a UMAT, before it is trusted: does it keep to its arguments, and is DDSDDE the
derivative of its stress?"""

from __future__ import annotations

import numpy as np

from ..common import tensors
from ..common.errors import SolverError

SIZES = 10.0 ** np.arange(-3, 1)
"""Of ``check_strain``: lengths of the strains that are tried."""
STEPS = 1e-5, 1e-3
"""Of the strain: steps of the differences.  The larger is for stress that iterations have found."""
WRONG = 1e-2
"""Of the largest entry: what a tangent may be off."""
KINK = 1e-1
"""The same between differences to both sides: there is no derivative there."""
SEVERAL = 3
"""So many states, of fifty to eighty, with a wrong tangent are no kinks that were missed."""


def check_guards(law, dim: int) -> None:
    """Call the routine for strains of many sizes.  Raises ``ValueError`` where it writes beyond its
    arguments, or cannot answer."""
    try:
        strain, stress, history, given = _trials(law, dim)
        law.tangent(strain, stress, history, given)
    except SolverError as error:
        raise ValueError(
            f"{error}; check_pressure = {law.check_pressure} and check_strain = {law.check_strain} "
            "say where it is tried: give a pressure that the law can bear, or a smaller strain"
        ) from error


def check_tangent(law, dim: int) -> None:
    """Compare DDSDDE with differences of the stress.  Raises ``ValueError`` for one that differs in
    several states where there is a derivative."""
    strain, stress, history, given = _trials(law, dim)
    wrong, worst = 0, (0.0, 0, (0, 0))
    for row in range(len(strain)):
        rows = slice(row, row + 1)
        state = stress[rows], history[rows], _at(given, rows)
        tangent = law.tangent(strain[rows], *state)[2][0]
        off = _difference(law, strain[row], state, tangent)
        if off is None or off.max() <= WRONG:
            continue
        wrong += 1
        if off.max() > worst[0]:
            worst = off.max(), row, np.unravel_index(off.argmax(), off.shape)
    if wrong >= SEVERAL:
        off, row, (i, j) = worst
        raise ValueError(
            f"DDSDDE of {law.symbol} is not the derivative of its stress in {wrong} of "
            f"{len(strain)} states tried, by up to {off:.2g} of its largest entry, in row {i + 1}, "
            f"column {j + 1} (in the order xx, yy, zz, xy, yz, xz) after the strain {strain[row]} "
            f"from the stress {stress[row]} Pa: shear strains are engineering strains, columns are "
            "strains, and after flow it is the consistent tangent; check_tangent=False takes it as "
            "it is, at the price of more solves a step"
        )


def _difference(law, strain, state, tangent) -> np.ndarray | None:
    """What a tangent is off (components, components), relative to its largest entry, by the better
    of two steps; None at a kink."""
    count, best = len(strain), None
    size = np.abs(tangent).max(initial=np.finfo(float).tiny)
    stress, history, given = state
    many = [np.repeat(a, 2 * count + 1, axis=0) for a in (stress, history)]
    given = {name: np.repeat(value, 2 * count + 1) for name, value in given.items()}
    for step in STEPS:
        h = step * np.abs(strain).max()
        moves = np.concatenate((np.zeros((1, count)), h * np.eye(count), -h * np.eye(count)))
        found = law.respond(strain + moves, *many, given)[0]
        up, down = (found[1 : count + 1] - found[0]) / h, (found[0] - found[count + 1 :]) / h
        if np.abs(up - down).max() > KINK * size:
            continue
        off = np.abs(0.5 * (up + down).T - tangent) / size
        if best is None or off.max() < best.max():
            best = off
    return best


def _trials(law, dim: int):
    """Strains, stresses, state variables and parameters of the trial calls."""
    count = tensors.components(dim)
    rng = np.random.default_rng(0)
    directions = np.concatenate((np.eye(count), -np.eye(count), rng.normal(size=(4, count))))
    strain = (law.check_strain * SIZES[:, None, None] * directions).reshape(-1, count)
    stress = np.zeros_like(strain)
    stress[:, :3] -= law.check_pressure
    given = {"size": np.full(len(strain), law.length)} if law.length else {}
    return strain, stress, law.initial_history(stress, given), given


def _at(given: dict, rows: slice) -> dict:
    return {name: value[rows] for name, value in given.items()}
