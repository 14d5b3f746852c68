"""What a term adds to a run: virtual work, energies, what it does before and after a step."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import ufl
from dolfinx import fem

from ..common.checks import in_short
from ..common.spread import Spread
from ..grid.consistent_mass import ConsistentMass

SUMS = ("left", "lost")
"""What the recorder Energy makes of all energies: no name for one of them."""


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
    ``spread``: of arrays in ``memory`` that are not the same on every rank, whether their rows are
    those of the grid's nodes or of its cells, ghosts included: they go to other ranks with these.
    Rows of surface points cannot.
    ``symmetric``: whether the derivative of ``work`` is.
    ``history``: fields, other than those of the motion, that ``work`` is linear in together with u,
    all else in it depending on the length of the step alone: it is then assembled once.
    ``holds``: it keeps a body from rigid motions that supports leave free, as springs do; a
    quasi-static run then does not refuse those.
    ``note``: what ``print(run)`` says of the term beyond its name.
    ``mass``: where ``work`` is that of inertia in the motion's acceleration and nothing else, the
    mass, which gives the force without the form.

    Where a run binds the term, ``check`` refuses what is none of these; the forms of ``energy``
    are looked at when a recorder asks for them.
    """

    work: object = 0
    force: object = 0
    energy: Callable[[], dict[str, object]] = _no_energy
    before: list[Callable[[float, float], None]] = field(default_factory=list)
    after: list[Callable[[], None]] = field(default_factory=list)
    memory: Mapping[str, np.ndarray] = field(default_factory=dict)
    spread: Mapping[str, Spread] = field(default_factory=dict)
    symmetric: bool = True
    history: Sequence[fem.Function] = ()
    holds: bool = False
    note: str = ""
    mass: ConsistentMass | None = None
    term: str = field(default="a term", init=False)  # the name of its class

    def check(self) -> None:
        """Raise ``ValueError`` naming the term where functions or memory are none."""
        if not callable(self.energy) or not _takes(self.energy):
            raise ValueError(
                f"terms: energy of {self.term} must be a function without arguments that returns "
                f"forms by name, got {in_short(self.energy)}"
            )
        for name, arguments, call in (("before", 2, "before(start, end)"), ("after", 0, "after()")):
            hooks = getattr(self, name)
            if not isinstance(hooks, list) or not all(map(callable, hooks)):
                raise ValueError(
                    f"terms: {name} of {self.term} must be a list of functions, got "
                    f"{in_short(hooks)}"
                )
            for hook in hooks:
                if not _takes(hook, *[0.0] * arguments):
                    raise ValueError(
                        f"terms: {name} of {self.term} must be functions that can be called as "
                        f"{call}, got {in_short(hook)}"
                    )
        if not isinstance(self.memory, Mapping):
            raise ValueError(
                f'terms: memory of {self.term} must be arrays by name, such as {{"slip": slip}}, '
                f"got {in_short(self.memory)}"
            )
        for name, value in self.memory.items():
            if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
                raise ValueError(
                    f"terms: memory of {self.term} must be arrays of numbers by name, which change "
                    f"in place, got {name!r}: {in_short(value)}"
                )
        kinds = Spread.NODES, Spread.CELLS
        if not isinstance(self.spread, Mapping) or any(
            name not in self.memory or lies not in kinds for name, lies in self.spread.items()
        ):
            raise ValueError(
                f"terms: spread of {self.term} must be Spread.NODES or Spread.CELLS by names of "
                f"memory, got {in_short(self.spread)}"
            )

    def energies(self) -> dict[str, ufl.Form]:
        """What ``energy`` returns.  Raises ``ValueError`` naming the term where that is no forms
        by name."""
        forms = self.energy()
        if not isinstance(forms, Mapping):
            raise ValueError(
                f"terms: energy of {self.term} must return forms by name, such as "
                f'{{"stored": form}}, got {in_short(forms)}'
            )
        for name, form in forms.items():
            if not isinstance(name, str) or name in SUMS:
                raise ValueError(
                    f"terms: energy of {self.term} is named {name!r}: give it a name of its own, a "
                    f"text other than {' and '.join(SUMS)}, which Energy has for sums"
                )
            whose = f"terms: energy {name!r} of {self.term}"
            if not isinstance(form, ufl.Form) or form.empty():
                raise ValueError(
                    f"{whose} must be a form, such as inner(traction, motion.u) * patch.measure, "
                    f"got {in_short(form)}; leave out what is zero"
                )
            if form.arguments():
                raise ValueError(
                    f"{whose} must be a number of J when it is integrated, and has the test "
                    "function w of the motion: put the increment u in its place"
                )
        return dict(forms)


def _takes(function: Callable, *arguments: float) -> bool:
    """Whether a function can be called with so many arguments, as far as it says."""
    try:
        inspect.signature(function).bind(*arguments)
    except TypeError:
        return False
    except ValueError:  # some built-in and compiled functions do not say
        return True
    return True
