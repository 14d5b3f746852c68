"""A far field: finite elements where strains stay small, beside the points where they do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..common.checks import check_flags, chosen
from ..common.ranks import anywhere, together, warn
from ..grid import weak_forms
from ..materials.law_checks import check_law
from .contribution import Contribution
from .plain_cells import PlainCells
from .regions import Regions, held, numbers, regions_of
from .scene import Scene

STRAINED = 0.01
"""Shear strain from which on a far field warns."""
EVERY = 10
"""Steps from one look at it to the next."""


@dataclass(frozen=True, eq=False)
class FarField:
    """Linear elastic finite elements of small strain in cells of the grid that hold no points.

    ``where`` maps x (dim, n), m, to bool (n,), and is asked at the cells' centres; ``material``:
    one, or pairs (material, where) for layers.  The cells share nodes with those that hold points,
    and bond to them: the two cannot part.  Loads, supports and absorbing boundaries on the grid's
    facets act on the cells that these belong to.
    ``fair``: nodal velocity and acceleration of the points' cells count the far field's too at the
    nodes that they share, by its consistent mass; it then sends back a fifth of short waves, and
    with the trapezoidal rule alone (``GeneralizedAlpha`` leaks momentum by it).
    ``follows``: the grid, and what is on it, moves with the mean of the nodes that the far field
    shares with points, which may settle by some cells then; without it more than a tenth of a cell
    is refused.
    ``start``: a run with a far field in the same cells, whose displacement and, in dynamics,
    velocity this one goes on from.
    Strains are to stay small: above ``STRAINED`` a warning says so, and
    ``run.far_field_strain()`` tells.
    Raises ``ValueError`` for cells with material points, a material that yields or is of finite
    strain, and cells of no material.
    """

    where: Callable
    material: object
    fair: bool = False
    follows: bool = False
    start: object = None

    beside_others = False

    def __post_init__(self) -> None:
        check_flags(fair=self.fair, follows=self.follows)

    def take_cells(self, scene: Scene) -> None:
        """Take the cells."""
        grid, regions = scene.grid, self.materials()
        for law, _ in regions:
            check_law(law, grid.dim)
            if not law.linear or law.kinematics.finite:
                raise ValueError(
                    f"material of FarField must be linear elastic at small strain, got {law!r}: "
                    "where soil yields or strains much, take material points"
                )
        with together(grid.comm, Exception):
            marks = chosen("where of FarField", self.where, grid.centres.T)
        part = scene.claim(self, marks)
        found = held("FarField", grid, regions, grid.centres, part.cells)
        part.density, part.λ, part.μ = (part.field(values) for values in numbers(regions, found))
        part.regions = [(law, here) for (law, _), here in zip(regions, found, strict=True)]
        part.dx, part.heavy = part.measure({"quadrature_degree": 3}), True
        part.centre = part.measure({"quadrature_degree": 1}) if scene.b_bar else None
        part.fair = self.fair and scene.motion.stepping.dynamic
        part.follows = self.follows
        if self.start is not None:
            part.go_on_from(self._before(part))

    def _before(self, part: PlainCells) -> PlainCells:
        """The same cells in the run before."""
        scene = getattr(self.start, "scene", None)
        if scene is None or scene.grid is not part.grid:
            raise ValueError(
                f"start of FarField must be a run on the same grid, got {type(self.start).__name__}"
            )
        for before in scene.plain:
            if before.heavy and np.array_equal(before.marks, part.marks):
                _refuse_other_ground(part, before)
                layer = any(not other.heavy for other in scene.plain)
                if layer or any(patch.has_springs for patch in scene.patches):
                    warn(
                        part.grid.comm,
                        "start of FarField carries what the far field has: springs on facets, and "
                        "an AbsorbingLayer, of the run before start unstressed; to go on as it was "
                        "take a checkpoint",
                        4,
                    )
                return before
        raise ValueError("start of FarField must be a run with a far field in the same cells")

    def without(self, where: Callable) -> FarField:
        """The same but for cells whose centres lie where another function says."""
        return replace(self, where=lambda x: self.where(x) & ~where(x), start=None)

    def materials(self) -> Regions:
        """Its materials, and where each is."""
        return regions_of(self.material)

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work of stress and, in dynamics, of inertia."""
        part, motion = scene.part(self), scene.motion
        work = force = part.elastic_work(motion.known(part.U) + motion.u, motion.w)
        if motion.stepping.dynamic:
            work += weak_forms.inertia(part.density, part.acceleration, motion.w) * part.dx
        return Contribution(
            work,
            force=force,
            after=[part.carry, Watch(part).look],
            memory=part.memory(),
            spread=part.spread(),
            history=part.history(),
            note=f"{part.count()} cells",
        )


def _refuse_other_ground(part: PlainCells, before: PlainCells) -> None:
    """Raise ``ValueError``, on all ranks, where the run before had other moduli or density."""
    same = all(
        np.array_equal(getattr(part, name).x.array, getattr(before, name).x.array)
        for name in ("density", "λ", "μ")
    )
    if anywhere(part.grid.comm, None if same else "other"):
        raise ValueError(
            "start of FarField must be a run whose far field is of the same material: its stress "
            "is that of the displacement"
        )


class Watch:
    """Warns once where strains of a far field are no longer small."""

    def __init__(self, part: PlainCells):
        self._part, self._calls, self._said = part, 0, False

    def look(self) -> None:
        """Every so many steps."""
        self._calls += 1
        if self._said or self._calls % EVERY:
            return
        strain = self._part.largest_strain()
        if strain > STRAINED:
            self._said = True
            warn(
                self._part.grid.comm,
                f"FarField is strained by {strain:.2g}, beyond what small strain and elasticity "
                f"serve, {STRAINED}: give the points more room",
            )
