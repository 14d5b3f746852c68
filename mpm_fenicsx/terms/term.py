"""What a term adds to the balance of forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass
class Contribution:
    """Virtual work of one term, the part of it that is a load or an internal force known before the
    step, and, on request, what it does to the energy in a step (J)."""

    work: object = 0
    energy: Callable[[], dict[str, object]] = dict
    force: object = 0
