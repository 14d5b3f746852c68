"""The free field: what the ground does at its sides where it goes on level.

A column of finite elements, one cell wide, with the rows of the side and tied sides of its own,
runs beside the run, a step ahead.  What it does is what comes in at that side, height by height;
dashpots, springs or a layer there bear what differs from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from mpi4py import MPI

import numpy as np

from ..common.checks import check_flags, several
from ..common.ranks import bounds, together
from ..grid.cells import SIDES
from ..grid.grid import Grid, GridSurface
from ..points.surface_points import SurfacePoints
from ..solver.solver import Solver
from ..terms.absorbing_layer import AbsorbingLayer
from ..terms.contribution import Contribution
from ..terms.incoming import IntoLayer, boundaries_on, into_boundaries, places
from ..terms.loads import Surface
from ..terms.regions import regions_of
from ..terms.scene import Scene
from ..terms.tied import Tied
from .doubtful_columns import refuse_free_base, warn_of_other_impedances, warn_of_other_terms
from .finite_elements import FiniteElements
from .side_column import Between, Memory, SideColumn

NEAR = 1e-6
"""Of the height: so near to the column's ends a grid line is its end."""


@dataclass(frozen=True, eq=False)
class FreeField:
    """The ground goes on level beyond a side, and moves there as a column of its own does.

    ``on``: a vertical side, facets of the grid or surface points, or several that make one side,
    on which ``ViscousBoundary`` or ``ViscoelasticBoundary`` acts, one a material in layered ground;
    one FreeField a side.  Or the ``AbsorbingLayer`` of the scene, all its sides and its base: the
    columns then go down to the bottom of the grid, where the wave comes in, and the run has no
    base of its own; between columns at two sides what comes in at the base is in proportion.
    ``material``: the ground beyond, any law that ``FiniteElements`` take, or pairs (material,
    where), ``where`` asked at the centres of the column's cells, x (dim, n), m; beside a layer the
    layer's own.
    ``terms``: maps the column's grid, with the facets "bottom" and "top", to what acts on it: the
    same base as the run's, gravity where there is ``stress``.  The column has the same rows as the
    grid from the lowest to the highest place of the side, and the same step; its sides are tied.
    ``stress``: its static state, a function such as ``GeostaticStress``; what comes in is what is
    added to that, so that the side of the run bears its own static tractions besides (see
    ``reactions``).  ``b_bar`` and ``solver`` are those of the column.

    ``columns``: their runs, once a run is built with this term.
    In 3D the ground at the side is level too: a column for the whole side, and one for all of a
    layer.
    Raises ``ValueError`` for a side that is not vertical, or absorbs nothing, and for ground beside
    a layer that is not the layer's.
    """

    on: Surface | Sequence[Surface] | AbsorbingLayer
    material: object
    terms: Callable[[Grid], Sequence]
    stress: Callable | None = None
    b_bar: bool | None = None
    solver: Solver | None = None
    columns: list[FiniteElements] = field(default_factory=list, init=False, repr=False)

    beside_others = 2  # after layers

    def __post_init__(self) -> None:
        if not callable(self.terms):
            raise ValueError(
                "terms of FreeField must be a function of the column's grid, such as lambda g: "
                f'[Fixed(g.facets("bottom"), "x", acceleration=record)], got {self.terms!r}'
            )
        if self.b_bar is not None:
            check_flags(b_bar=self.b_bar)

    def take_cells(self, scene: Scene) -> None:
        """The cells of a layer bear what differs from the free field."""
        if isinstance(self.on, AbsorbingLayer) and scene.motion.stepping.dynamic:
            scene.bring_into(self, self.on)

    def bind(self, scene: Scene) -> Contribution:
        """What the boundaries have to bear of the column's motion."""
        if not scene.motion.stepping.dynamic:
            raise ValueError(
                "FreeField needs velocities: step with Newmark, after a quasi-static run that "
                "holds the side"
            )
        if isinstance(self.on, AbsorbingLayer):
            columns = self._around(scene, self.on)
            part = scene.part(self.on)
            contribution = IntoLayer(scene, "FreeField", part, Between(columns)).bind()
        else:
            boundaries = [
                pair for on in self.surfaces for pair in boundaries_on(scene, "FreeField", on)
            ]
            columns = [self._column(scene, *self._extent(scene))]
            warn_of_other_terms(scene, columns[0].run)
            warn_of_other_impedances(scene, columns[0].run, boundaries)
            contribution = into_boundaries(scene, "FreeField", boundaries, columns[0])
        self.columns[:] = [column.run for column in columns]
        scene.ahead.extend(column.follow for column in columns)
        contribution.memory = Memory(self.columns)
        contribution.note = f"beside {' and '.join(str(c.grid.cells) for c in self.columns)} cells"
        return contribution

    @property
    def surfaces(self) -> Sequence[Surface]:
        """Those that make the side."""
        one = isinstance(self.on, GridSurface | SurfacePoints)
        return [self.on] if one else several("on", self.on, 'grid.facets("left")')

    def _extent(self, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest coordinates (dim,), m, of the side."""
        low, high = bounds(
            scene.grid.comm, np.concatenate([_corners(scene, on) for on in self.surfaces])
        )
        flat = high - low < NEAR * (high[1] - low[1])
        if not np.delete(flat, 1).any() or flat[1]:
            raise ValueError(
                f"on: FreeField is for one vertical side, got {self.on!r} from {low} to {high}: "
                "give each side a FreeField of its own"
            )
        return low, high

    def _around(self, scene: Scene, layer: AbsorbingLayer) -> list[SideColumn]:
        """Columns at the ends of what a layer lies beside: at its left and right side in 2D, at the
        first of its sides in 3D."""
        grid, part = scene.grid, scene.part(layer)
        for law, _ in regions_of(self.material):
            if not any(law == other for other, _ in regions_of(layer.material)):
                raise ValueError(
                    f"material: FreeField is of {law!r}, and the AbsorbingLayer beside of other "
                    "ground: give both the same; ground that yields takes dashpots at its sides"
                )
        x = grid.space.tabulate_dof_coordinates()[:, : grid.dim]
        low, high = bounds(scene.grid.comm, x[part.shared])
        names = [name for name in layer.sides if SIDES[name][0] != 1]
        if not names or "bottom" not in layer.sides:
            raise ValueError(
                "on: FreeField goes with an AbsorbingLayer at sides and bottom, got one at "
                f"{', '.join(layer.sides)}: below level ground IncidentWave is enough"
            )
        columns = []
        for name in names if grid.dim == 2 else names[:1]:
            d, end = SIDES[name]
            at = (high if end else low)[d]
            here = part.shared[np.abs(x[part.shared, d] - at) < NEAR * (high - low).max()]
            first, last = bounds(scene.grid.comm, x[here])
            first[1] = grid.lower_corner[1]
            first[d] = last[d] = at
            columns.append(self._column(scene, first, last))
        return columns

    def _column(self, scene: Scene, low: np.ndarray, high: np.ndarray) -> SideColumn:
        """A column one cell wide between these places (dim,), m."""
        y = scene.grid.mesh.geometry.x[:, 1]
        y = np.unique(np.concatenate(scene.grid.comm.allgather(y)).round(9))
        near = NEAR * (high[1] - low[1])
        lines = [a + np.array([-0.5, 0.5]) * scene.grid.smallest for a in 0.5 * (low + high)]
        inside = y[(y > low[1] + near) & (y < high[1] - near)]
        lines[1] = np.array([low[1], *inside, high[1]])
        grid = Grid.rectilinear(lines, comm=MPI.COMM_SELF)
        ties = [Tied(*pair) for pair in (("left", "right"), ("back", "front"))[: grid.dim - 1]]
        with together(scene.grid.comm, Exception):
            own = several("what terms of FreeField return", self.terms(grid), "a list of terms")
            run = FiniteElements(
                grid,
                self.material,
                scene.motion.stepping,
                [*ties, *own],
                solver=self.solver,
                b_bar=self.b_bar,
                stress=self.stress,
            )
        refuse_free_base(run)
        return SideColumn(run, 0.5 * (low + high))


def _corners(scene: Scene, on: Surface) -> np.ndarray:
    """Places (n, dim), m, between which a surface lies: nodes of facets, and of surface points the
    lower and upper edges of their faces."""
    if isinstance(on, GridSurface):
        return places(scene, on)
    x = on.x.reshape(-1, on.per_face, on.x.shape[1]).mean(axis=1)
    half = 0.5 * on.area.reshape(-1, on.per_face).sum(axis=1) ** (1 / (x.shape[1] - 1))
    up = half[:, None] * np.eye(x.shape[1])[1]
    return np.concatenate([x - up, x + up])
