"""What a term adds to a run: virtual work, energies, what it does before and after a step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ..common.checks import in_short


def _no_energy() -> dict[str, object]:
    return {}


@dataclass
class Contribution:
    """What one term does in a run.

    ``work``: its virtual work, a form of the increment u and the test function w of the motion; its
    derivative by u goes into the matrix.
    ``force``: the part of ``work`` that is a load, or an internal force that is known before the
    step: it tells how large the forces are that are in equilibrium.
    ``energy``: the term's own kinds of energy by name, forms of what a step adds to each (J); asked
    for only where a recorder ``Energy`` is attached.  "work" is what is done to the body, and
    every other name a place where energy went.
    ``before``: functions of the step's start and end (s), called before it is solved.
    ``after``: functions called when a step is made, halves of a step too.
    ``memory``: arrays by name that ``after`` changes in place, and that the next step depends on: a
    checkpoint keeps them, and a step that is taken back takes them back.
    ``symmetric``: whether the derivative of ``work`` is.
    ``holds``: it keeps a body from rigid motions that supports leave free, as springs do; a
    quasi-static run then does not refuse those.
    ``note``: what ``print(run)`` says of the term beyond its name.
    """

    work: object = 0
    force: object = 0
    energy: Callable[[], dict[str, object]] = _no_energy
    before: list[Callable[[float, float], None]] = field(default_factory=list)
    after: list[Callable[[], None]] = field(default_factory=list)
    memory: Mapping[str, np.ndarray] = field(default_factory=dict)
    symmetric: bool = True
    holds: bool = False
    note: str = ""

    def __post_init__(self) -> None:
        if not callable(self.energy):
            raise ValueError(
                "energy of a Contribution must be a function that returns forms by name, got "
                f"{in_short(self.energy)}"
            )
        for name in ("before", "after"):
            hooks = getattr(self, name)
            if not isinstance(hooks, list) or not all(map(callable, hooks)):
                raise ValueError(
                    f"{name} of a Contribution must be a list of functions, got {in_short(hooks)}"
                )
        for name, value in self.memory.items():
            if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
                raise ValueError(
                    f"memory of a Contribution must be arrays of numbers by name, which change in "
                    f"place, got {name!r}: {in_short(value)}"
                )
