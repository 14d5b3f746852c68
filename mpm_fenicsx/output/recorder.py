"""What a recorder is, and what it may ask of the run that it looks at."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from ..grid.grid import Grid
from ..grid.stress_field import StressField


class Run(Protocol):
    """A run as recorders see it.

    ``name`` of the method, ``grid``, ``bodies`` of material points (none of finite elements),
    ``steps`` done and ``time`` (s) reached.
    """

    name: str
    bodies: Sequence
    grid: Grid
    steps: int
    time: float

    def sampler(self, field: str) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
        """Places (n, dim), m, where a field is known on this rank, and a function from rows to
        values there."""

    def numbers_of(self, field: str, rows: np.ndarray) -> np.ndarray | None:
        """Numbers (m, k) that samples of a field keep where they may go to other rows and ranks,
        after which ``arrangement`` is another number and ``rows_of(field, numbers)`` says which are
        where; None where they stay."""

    def holds(self, at: np.ndarray) -> bool:
        """Whether a place (dim,), m, lies inside this rank's part of the body."""

    def term_energies(self) -> dict[str, object]:
        """Forms of what terms do to the energy in a step (J), by name."""

    def energy(self) -> dict[str, float]:
        """Energies (J) of this rank's part of the body, by name."""

    def stress_field(self) -> StressField:
        """The stress on the grid as it is now."""

    def grid_fields(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Fields to show on nodes (nodes, …) and in cells (cells, …), by name."""


class Recorder(Protocol):
    """Looks at a run when attached, and after each step.

    Four things it may have beyond the two that it needs:

    - ``state() -> dict`` of arrays by name, and ``restore(state)``: a checkpoint then keeps what it
      has recorded, under its ``label`` if it has one, else its class;
    - ``collect(run)``, called after every solve, of which a step can need several, and ``sums``, an
      array that it adds to in place: where a step is taken back, so are they;
    - ``moved(run)``, called when the run's grid has been divided anew among the ranks: what it
      keeps of the grid, or by rows, is to be asked for again;
    - ``last = True``: it looks after all others.
    """

    def attach(self, run: Run) -> None:
        """Look at the run for the first time, before its next step.

        Raises ``ValueError`` for one that it cannot serve, ``OSError`` where it cannot write.
        """

    def __call__(self, run: Run) -> None:
        """Look at the run after a step."""
