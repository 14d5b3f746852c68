"""What terms write their virtual work into: the motion, the density, and the surfaces they act on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import ufl

from .grid import Grid
from .loads import Load, as_load
from .motion import Motion
from .partition import anywhere
from .patches import patch


@dataclass
class Contribution:
    """Virtual work of one term, the part of it that is a load or an internal force known before the step, and, on
    request, what it does to the energy in a step (J)."""

    work: object = 0
    energy: Callable[[], dict[str, object]] = dict
    force: object = 0


@dataclass
class Scene:
    """Collects what the terms of a simulation need, and no more.

    ``density`` is the field or constant ρ (kg/m³); ``dx`` integrates what it weighs; ``lame`` are the fields λ and μ
    (Pa) of material points, which like ``density`` are less where a cell is partly filled.  ``body_force`` makes ρb
    (N/m³) of a body force per mass that varies in space, and what refreshes it: at nodes, where it is not given.
    """

    grid: Grid
    motion: Motion
    density: object
    dx: ufl.Measure
    lame: tuple = ()
    body_force: Callable | None = None
    fixed: list = field(default_factory=list)
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
        load, placed = as_load(name, value, self.grid.dim)
        self.loads.append(load)
        return load, placed

    def prepare(self, start: float, end: float) -> None:
        """Bring coefficients to the step from ``start`` to ``end`` (s).

        Raises ``ValueError`` on all ranks, naming it, where a load is not a number on one.
        """
        for load in self.loads:
            load.fault = None
        for p in self.patches.values():
            p.prepare(start, end)
        for refresh in self.before:
            refresh(start, end)
        fault = anywhere(self.grid.comm, next((load.fault for load in self.loads if load.fault), None))
        if fault:
            raise ValueError(fault)

    def mark(self, cells: np.ndarray) -> None:
        """Mark the cells that hold surface points."""
        for p in self.patches.values():
            p.mark(cells)

    def mark_loaded(self, cells: np.ndarray) -> None:
        """Mark the cells (cells,) on which surfaces act: 2 where surface points do, 1 where facets do."""
        for p in self.patches.values():
            p.mark_loaded(cells)

    def carry(self) -> None:
        """After the step: surfaces move, springs remember."""
        for p in self.patches.values():
            p.carry()
