"""Where a run knows its fields: samples of material points, and of the far fields beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..points.material_points import MaterialPoints
from ..terms.plain_cells import PlainCells


@dataclass(frozen=True)
class Samples:
    """Those of this rank of one body or far field, ``whose`` number: of bodies 0, 1, …, of far
    fields -1, -2, ….

    ``numbers`` (n,) tell them apart on all ranks, ``places`` (n, dim), m, are where they are now,
    ``read`` maps rows (k,) to values (k, …).
    """

    whose: int
    numbers: np.ndarray
    places: np.ndarray
    read: Callable[[np.ndarray], np.ndarray]


def samples_of(
    field: str, bodies: Sequence[MaterialPoints], far: Sequence[PlainCells]
) -> list[Samples]:
    """Those of material points, and after them those of far fields, now.

    Raises ``ValueError`` for a field that points do not have.
    """
    name = "x" if field == "displacement" else field
    if any(getattr(body, name) is None for body in bodies):
        raise ValueError(f"field {field!r} is not part of this scene")

    def of_points(whose: int, body: MaterialPoints) -> Samples:
        numbers = np.arange(len(body)) if body.number is None else body.number

        def values(rows: np.ndarray) -> np.ndarray:
            found = getattr(body, name)[rows]
            goes_on = name == "x" and body.jumped is not None
            return found - body.jumped[rows] if goes_on else found

        return Samples(whose, numbers, body.x, values)

    def of_cells(whose: int, part: PlainCells) -> Samples:
        places, numbers = part.samples(field)
        return Samples(whose, numbers, places, lambda rows: part.values(field, rows))

    found = [of_points(whose, body) for whose, body in enumerate(bodies)]
    return found + [of_cells(-1 - k, part) for k, part in enumerate(far)]


def read(samples: Sequence[Samples], rows: np.ndarray) -> np.ndarray:
    """Values (k, …) of rows (k,) of all samples, one after the other."""
    if len(samples) == 1:
        return samples[0].read(rows)
    first, found, order = 0, [], []
    for one in samples:
        asked = np.flatnonzero((rows >= first) & (rows < first + len(one.numbers)))
        found.append(one.read(rows[asked] - first))
        order.append(asked)
        first += len(one.numbers)
    return np.concatenate(found)[np.argsort(np.concatenate(order), kind="stable")]


def named(samples: Sequence[Samples], rows: np.ndarray) -> np.ndarray:
    """Whose, and which number (k, 2), rows (k,) of all samples are."""
    whose = np.concatenate([np.full(len(one.numbers), one.whose) for one in samples])
    return np.column_stack((whose, np.concatenate([one.numbers for one in samples])))[rows]


def found(samples: Sequence[Samples], names: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows (k,) of those samples of ``names`` (m, 2) that are on this rank now, and which (k,) of
    them these are, in their order."""
    rows, which, first = [], [], 0
    for one in samples:
        asked = np.flatnonzero(names[:, 0] == one.whose)
        asked = asked[np.argsort(names[asked, 1], kind="stable")]
        here = np.flatnonzero(np.isin(one.numbers, names[asked, 1]))
        rows.append(first + here)
        which.append(asked[np.searchsorted(names[asked, 1], one.numbers[here])])
        first += len(one.numbers)
    order = np.argsort(np.concatenate(which))
    return np.concatenate(rows)[order], np.concatenate(which)[order]
