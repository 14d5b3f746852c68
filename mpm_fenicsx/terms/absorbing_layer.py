"""A layer of cells that absorbs waves at every angle and frequency: cells of complex length.

In a layer lengths across it are stretched by s = κ + β/p, p the Laplace variable, constant in a
cell, and across it the midpoint rule is taken: a cell of *any* length then has the impedance of the
half-space (perfectly matched discrete layers; Guddati & Lim, Int. J. Numer. Methods Eng. 66,
949-977, 2006).  A cell with κ = 0 and β = 2c/h absorbs waves that reach it with the speed c, and a
few of them, of well chosen speeds, all (``layer_cells``); elastic cells behind them, of growing
length, bear what does not travel.  In two directions at once it is the corner of two layers.

The matrix of the step is that of elasticity with real stretches: symmetric, definite, as sparse as
that of the grid, and constant; see ``stretched_cells``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from ..common.checks import check_flags, one_of, whole
from ..common.ranks import anywhere, bounds
from ..grid import dolfinx_versions
from ..grid.cells import SIDES
from ..grid.grid import Grid
from ..materials.law_checks import has
from .contribution import Contribution
from .layer_cells import default_cells
from .layer_rules import Body, Stratum, refusal
from .plain_cells import PlainCells
from .regions import Regions, held, numbers, regions_of
from .scene import Scene
from .stretched_cells import StretchedCells
from .supports import Fixed


@dataclass(frozen=True, eq=False)
class AbsorbingLayer:
    """The outermost cells of the grid at ``sides`` absorb the waves that come to them.

    ``sides``: names such as ("left", "right", "bottom"); ``material``: the elastic ground that goes
    on there, with ``density``, ``lame``, ``p_speed`` and ``s_speed``, or pairs (material, where) of
    layered ground, ``where`` mapping x (dim, n), m, at the body's edge to bool (n,).  ``absorbing``
    cells, from the inside outwards, then ``elastic`` ones: the grid has these ``absorbing +
    elastic`` cells beyond the body, without points.  The layer lies beside cells with material
    points, finite elements or a far field, and ends where these do; the grid's nodes at these sides
    are held.  In a quasi-static run it is empty: hold the body's edge there with Fixed
    (``Grid.inner_facets``), and give what that bears to the dynamic run (``reactions``), in which
    the layer bears what moves from the start on.
    ``follows``: the grid, and what is on it, moves with the mean of the nodes that the layer shares
    with points.  Without it more than a tenth of a cell is refused, and a fiftieth warned of:
    points that moved by a twentieth from the layer's cells lost 9 % of the work of a load.  A far
    field between points and layer serves better.
    Raises ``ValueError`` for what would grow in time or absorb nothing, saying what to take
    instead.
    """

    sides: Sequence[str]
    material: object
    absorbing: int = 3
    elastic: int = 4
    follows: bool = False

    beside_others = True

    def __post_init__(self) -> None:
        names = (self.sides,) if isinstance(self.sides, str) else tuple(self.sides)
        object.__setattr__(self, "sides", names)
        if not names or len(set(names)) < len(names):
            raise ValueError(f"sides must be one side of the grid or several, got {self.sides!r}")
        for name in names:
            one_of("sides", name, SIDES)
        for law, _ in regions_of(self.material):
            has("material of AbsorbingLayer", law, ("density", "lame", "p_speed", "s_speed"))
        check_flags(follows=self.follows)
        whole("absorbing", self.absorbing)
        whole("elastic", self.elastic, least=0)

    @property
    def thickness(self) -> int:
        """Cells across."""
        return self.absorbing + self.elastic

    def take_cells(self, scene: Scene) -> None:
        """Take the cells."""
        if any(part.owner == type(self).__name__ for part in scene.plain):
            raise ValueError("terms: a scene takes one AbsorbingLayer: name all its sides in it")
        grid = scene.grid
        depth = np.stack([self._depth(grid, name) for name in self.sides], axis=1)
        inside = (depth < 0).all(axis=1)
        _refuse_points(scene, ~inside)
        filled = scene.filled() & inside
        body = filled.copy()
        for name, of_side in zip(self.sides, depth.T, strict=True):
            d, end = SIDES[name]
            for k in range(self.thickness):
                at = np.flatnonzero(of_side == k)
                inward = grid.lattice.neighbour[at, d, 1 - end]
                filled[at] = (inward >= 0) & filled[inward]
                filled = grid.share_cells(filled)
        if not scene.motion.stepping.dynamic:
            scene.empty = filled & ~inside
            return
        part = scene.claim(self, filled & ~inside)
        part.depth, part.body, regions = depth, body, regions_of(self.material)
        part.follows = self.follows
        edge = np.clip(grid.centres, *bounds(grid.comm, grid.centres[inside]))
        found = held("AbsorbingLayer", grid, regions, edge, part.cells)
        part.density, part.λ, part.μ = (part.field(values) for values in numbers(regions, found))
        part.strata = _strata(grid, regions, found & part.marks)

    def _depth(self, grid: Grid, name: str) -> np.ndarray:
        """Which cell of the layer, 0 for the innermost, each cell of the grid (cells,) is; below 0
        where it lies inside."""
        d, end = SIDES[name]
        if d >= grid.dim:
            raise ValueError(f"sides: a grid in {grid.dim}D has no side {name!r}")
        index = grid.index[:, d]
        many = 1 + grid.comm.allreduce(int(index.max(initial=0)), op=MPI.MAX)
        opposite = sum(SIDES[other][0] == d for other in self.sides)
        if many <= opposite * self.thickness:
            raise ValueError(
                f"AbsorbingLayer of {self.thickness} cells at {' and '.join(self.sides)} leaves "
                f"nothing of the grid, which has {many} cells in that direction: make the grid "
                f"wider by {self.thickness} cells at each of these sides"
            )
        return index - (many - self.thickness) if end else self.thickness - 1 - index

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work of stretched cells, the last nodes of which are held."""
        motion, grid = scene.motion, scene.grid
        if not motion.stepping.dynamic:
            return Contribution(note="empty in a quasi-static run")
        part = scene.part(self)
        cells = StretchedCells(part, *self._stretches(grid, part.depth))
        Fixed(grid.facets(*self.sides)).bind(scene)
        contribution = Contribution(
            cells.work(motion.w, 1.0, motion.stepping.start),
            after=[cells.carry],
            memory=cells.memory(),
            spread=cells.spread(),
            history=cells.history(),
            note=f"{part.count()} cells",
        )
        contribution.energy = lambda: {"absorbed": cells.work_of_step(contribution)}
        return contribution

    def check(self, scene: Scene) -> None:
        """Raise ``ValueError`` where body and layer would grow (``layer_rules``)."""
        if not scene.motion.stepping.dynamic:
            return
        part, grid = scene.part(self), scene.grid
        _refuse_loads(scene, part)
        low, high = bounds(grid.comm, grid.centres[part.body])
        size = grid.lattice.size[part.body]
        least = np.array([grid.comm.allreduce(h, op=MPI.MIN) for h in size.min(0, initial=np.inf)])
        directions = np.arange(grid.dim)
        body = Body(
            extent=high - low + least,
            one_cell=high - low < 0.5 * least,
            open=np.isin(directions, [SIDES[name][0] for name in self.sides]),
            plane=_held_plane(scene, part),
        )
        reason = refusal(self.absorbing, self.elastic, body, part.strata)
        if reason:
            raise ValueError(f"AbsorbingLayer at {', '.join(self.sides)} {reason}")

    def _stretches(self, grid: Grid, depth: np.ndarray) -> tuple[np.ndarray, ...]:
        """κ, β (1/s) and whether a direction is stretched at all, (cells, dim) each."""
        kappa, beta = np.ones((grid.cells, grid.dim)), np.zeros((grid.cells, grid.dim))
        across = np.zeros((grid.cells, grid.dim), dtype=bool)
        speeds = np.array(
            default_cells(
                [law for law, _ in regions_of(self.material)], 1.0, self.absorbing, self.elastic
            )
        )
        size = grid.lattice.upper - grid.lattice.lower
        for name, of_side in zip(self.sides, depth.T, strict=True):
            d = SIDES[name][0]
            at = np.flatnonzero(of_side >= 0)
            κ, c = speeds[of_side[at]].T
            kappa[at, d], beta[at, d], across[at, d] = κ, c / size[at, d], True
        return kappa, beta, across


def _refuse_points(scene: Scene, zone: np.ndarray) -> None:
    """Raise ``ValueError``, on all ranks, where points lie in the layer's cells."""
    fault = None
    if scene.occupied is not None and (scene.occupied & zone).any():
        at = scene.grid.centres[np.argmax(scene.occupied & zone)]
        fault = (
            f"AbsorbingLayer: there are material points in its cell at x={at}: make the grid wider "
            "by the layer's cells, or fill the body with points only inside of it"
        )
    fault = anywhere(scene.grid.comm, fault)
    if fault:
        raise ValueError(fault)


def _refuse_loads(scene: Scene, part: PlainCells) -> None:
    """Raise ``ValueError``, on all ranks, for terms on surfaces of the layer's own cells, and
    motions given to its nodes."""
    found = [
        f"{' and '.join(patch.acting)} on {patch} acts on"
        for patch in scene.patches
        if part.marks[patch.cells[patch.cells >= 0]].any()
    ]
    dofs = [known.dofs // scene.grid.dim for known in scene.motion.moved]
    found += ["Fixed gives a motion to" for nodes in dofs if np.isin(nodes, part.own).any()]
    first = anywhere(scene.grid.comm, found[0] if found else None)
    if first:
        raise ValueError(
            f"on: {first} cells of the AbsorbingLayer, which stand for ground further out: name "
            "facets of the body alone (Grid.box(..., facets=))"
        )


def _strata(grid: Grid, regions: Regions, found: np.ndarray) -> list[Stratum]:
    """The materials of a layer that are in its cells, of all ranks, and their heights."""
    strata = []
    for (law, _), here in zip(regions, found[:, : grid.owned_cells], strict=True):
        y = grid.centres[: grid.owned_cells][here, 1]
        count, total = grid.comm.allreduce(len(y)), grid.comm.allreduce(float(y.sum()))
        if count:
            strata.append(Stratum(total / count, law.s_speed))
    return strata


def _held_plane(scene: Scene, part: PlainCells) -> np.ndarray:
    """In which directions (dim,), bool, all nodes of layer and body are held across, or along and
    not across, or sides are tied."""
    grid = scene.grid
    nodes = np.unique(dolfinx_versions.cell_dofs(grid.space)[part.marks | part.body])
    fixed = np.zeros(grid.nodes * grid.dim, dtype=bool)
    for condition in scene.fixed:
        fixed[condition.dof_indices()[0]] = True
    all_held = fixed.reshape(-1, grid.dim)[nodes].all(axis=0)
    all_held = np.array([grid.comm.allreduce(int(h), op=MPI.MIN) for h in all_held], dtype=bool)
    others = np.array([np.delete(all_held, d).all() for d in range(grid.dim)])
    tied = scene.sides.directions if scene.sides is not None and scene.sides.whole else []
    return all_held | others | np.isin(np.arange(grid.dim), tied)
