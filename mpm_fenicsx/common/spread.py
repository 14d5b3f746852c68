"""How the state of a run lies on its ranks."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

import numpy as np


class Spread(Enum):
    """Where the values of an array belong, so that they can go to other ranks."""

    ALIKE = "the same on every rank"
    NODES = "rows of the grid's nodes, ghosts included"
    CELLS = "rows of the grid's cells, ghosts included, as many for each"
    ROWS = "rows of points, which are where their cell is"


class Part(NamedTuple):
    """What one rank has, or had, of a run's state.

    ``cells`` and ``nodes``: their numbers, the same on any number of ranks; those that the rank
    owns come first, ``owned`` (2,) of each.  ``weight`` of each cell that it owns, where the grid
    is divided by such, else of none.  ``state``: arrays by name.
    """

    cells: np.ndarray
    nodes: np.ndarray
    owned: np.ndarray
    weight: np.ndarray
    state: dict[str, np.ndarray]


def below(prefix: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays whose names begin so, by the rest of their names."""
    return {name[len(prefix) :]: value for name, value in arrays.items() if name.startswith(prefix)}
