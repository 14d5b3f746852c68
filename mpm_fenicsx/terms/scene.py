"""What terms write their virtual work into: the motion, the density, and the surfaces they act
on."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import ufl

from ..common.ranks import anywhere
from ..dynamics.motion import Motion
from ..dynamics.prescribed_motion import Prescribed
from ..grid.grid import Grid
from .boundary_patches import patch
from .load_functions import TRIALS, Load, as_load


@dataclass
class Scene:
    """Collects what the terms of a simulation need, and no more.

    ``density`` is the field or constant ρ (kg/m³); ``dx`` integrates what it weighs; ``lame`` are
    the fields λ and μ (Pa) of material points, which like ``density`` are less where a cell is
    partly filled.  ``body_force`` makes ρb (N/m³) of a body force per mass that varies in space,
    and what refreshes it: at nodes, where it is not given. ``at_rest``: integrals are taken in the
    configuration at rest, where surface points stay.
    """

    grid: Grid
    motion: Motion
    density: object
    dx: ufl.Measure
    lame: tuple = ()
    body_force: Callable | None = None
    at_rest: bool = False
    fixed: list = field(default_factory=list)
    prescribed: list[Prescribed] = field(default_factory=list)
    before: list[Callable[[float, float], None]] = field(default_factory=list)
    patches: dict[int, object] = field(default_factory=dict)
    loads: list[Load] = field(default_factory=list)
    body_loaded: bool = False

    def patch(self, surface):
        """The boundary patch of a surface, one for all terms that act on it."""
        if id(surface) not in self.patches:
            self.patches[id(surface)] = patch(surface, self)
        return self.patches[id(surface)]

    def load(self, name: str, value) -> tuple[Load, bool]:
        """A load as ``as_load`` returns it, with an eye on its values."""
        low, high = self.grid.lower_corner, self.grid.upper_corner
        places = low + np.linspace(0.1, 0.9, TRIALS)[:, None] * (high - low)
        load, placed = as_load(name, value, self.grid.dim, places)
        self.loads.append(load)
        return load, placed

    def prepare(self, start: float, end: float) -> None:
        """Bring coefficients to the step from ``start`` to ``end`` (s).

        Raises ``ValueError`` on all ranks, naming it, where a load is not a number on one.
        """
        for load in self.loads:
            load.fault = None
        for known in self.motion.moved:
            known.prepare(start, end, self.motion.stepping)
        for p in self.patches.values():
            p.prepare(start, end)
        for refresh in self.before:
            refresh(start, end)
        fault = anywhere(
            self.grid.comm, next((load.fault for load in self.loads if load.fault), None)
        )
        if fault:
            raise ValueError(fault)

    def mark(self, cells: np.ndarray) -> None:
        """Mark the cells that hold surface points."""
        for p in self.patches.values():
            p.mark(cells)

    def mark_loaded(self, cells: np.ndarray) -> None:
        """Mark the cells (cells,) on which surfaces act: 2 where surface points do, 1 where facets
        do."""
        for p in self.patches.values():
            p.mark_loaded(cells)

    def go_on_from(self, other: Scene) -> None:
        """Springs take over what those of another scene on the same surface have accumulated.

        Raises ``ValueError`` where only a part of a surface had springs before; warns where springs
        of before are on none of the surfaces that have springs now, and other surfaces are new.
        """
        before = [p for p in other.patches.values() if p.has_springs]
        gone, new = list(before), []
        for p in self.patches.values():
            if p.has_springs:
                same = p.take(before)
                gone = [q for q in gone if q not in same]
                new += [] if same else [p]
        if gone and new:
            warnings.warn(
                f"start: springs on {new[0]} start unstressed, and what those of the run before "
                f"bear on {gone[0]} is gone: give the same facets, or the same surface points, if "
                "they are the same springs",
                UserWarning,
                stacklevel=4,
            )

    def carry(self) -> None:
        """After the step: surfaces move, springs remember, records go on."""
        for p in (*self.patches.values(), *self.prescribed):
            p.carry()

    def state(self) -> dict[str, np.ndarray]:
        """Arrays of surfaces and records that a restart needs, by name; not copied."""
        kinds = {"surfaces": self.patches.values(), "prescribed": self.prescribed}
        return {
            f"{kind}/{k}/{name}": value
            for kind, parts in kinds.items()
            for k, part in enumerate(parts)
            for name, value in part.state().items()
        }
