"""What a recorder is, and what it may ask of the run that it looks at."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol, runtime_checkable

import numpy as np

from ..grid.grid import Grid


class Run(Protocol):
    """A run as recorders see it.

    ``name`` of the method, ``grid``, ``steps`` done and ``time`` (s) reached; ``contributions`` of
    the terms, which say what they do to the energy; ``collectors``, whose ``collect`` is called
    after every solve.
    """

    name: str
    grid: Grid
    steps: int
    time: float
    contributions: list
    collectors: list

    def sampler(self, field: str) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
        """Places (n, dim), m, where a field is known on this rank, and a function from rows to
        values there."""

    def holds(self, at: np.ndarray) -> bool:
        """Whether a place (dim,), m, lies inside this rank's part of the body."""

    def energy(self) -> dict[str, float]:
        """Energies (J) of this rank's part of the body, by name."""

    def grid_fields(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Fields to show on nodes (nodes, …) and in cells (cells, …), by name."""


@runtime_checkable
class Recorder(Protocol):
    """Looks at a run when attached, and after each step.

    One that remembers has ``state()``, arrays by name, and ``restore(state)``: a checkpoint then
    keeps what it has recorded, under its ``label`` if it has one.  One with ``last = True`` looks
    after all others.
    """

    def attach(self, run: Run) -> None:
        """Look at the run for the first time, before its next step.  Raises ``ValueError`` for one
        that it cannot serve, ``OSError`` where it cannot write."""

    def __call__(self, run: Run) -> None:
        """Look at the run after a step."""


@runtime_checkable
class Remembering(Protocol):
    """A recorder whose record goes on after a restart."""

    def state(self) -> dict[str, np.ndarray]:
        """Arrays by name, all that ``restore`` needs."""

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from what a checkpoint kept."""
