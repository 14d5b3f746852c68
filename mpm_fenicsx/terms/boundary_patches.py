"""Boundary patches: a surface as the forms see it, facets of the grid or points inside cells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, singledispatch

import numpy as np
import ufl
from dolfinx import fem

from ..common import tensors
from ..common.ranks import anywhere, keepers
from ..grid import dolfinx_versions, weak_forms
from ..grid.grid import GridSurface
from ..mapping.projection import AT_NODES, Projection, simpson
from ..mapping.shape_functions import Stencil
from ..mapping.surface_faces import Faces
from ..points.migration import Destinations, Migration, resized
from ..points.surface_points import SurfacePoints
from .facets import on_facets
from .load_functions import Load, combined


@singledispatch
def patch(surface, scene):
    """The boundary patch that serves a surface's coefficients to the forms."""
    raise ValueError(f"on must be facets of the grid or surface points, got {surface!r}")


INWARD = 1e-6
"""Of the way from a place to the centre of its cell: a hair inside."""


class FacetPatch:
    """A surface of grid facets: coefficients are constants, integrals go over ``ds``."""

    def __init__(self, surface: GridSurface, scene):
        if surface.grid is not scene.grid:
            raise ValueError(f"on: the facets {surface.names} belong to another grid")
        self.grid, self.motion = scene.grid, scene.motion
        self.measure, self.surface = surface.measure, surface
        self.tags, self.points = set(surface.tags), None
        self.acting: list[str] = []
        self._refresh: list[Callable[[float, float], None]] = []
        self._total: fem.Function | None = None
        self.on_the_mesh = False  # whether it bears a load that is a field there
        self.of_its_own = False

    @cached_property
    def cells(self) -> np.ndarray:
        """The cells that the facets belong to."""
        topology, dim = self.grid.mesh.topology, self.grid.dim
        topology.create_connectivity(dim - 1, dim)
        beside = topology.connectivity(dim - 1, dim)
        return np.unique([beside.links(facet)[0] for facet in self.surface.facets]).astype(np.int32)

    def tensor(self, along: float, across: float):
        """Tensor with eigenvalue ``along`` the outward normal and ``across`` it."""
        mesh = self.grid.mesh
        values = (fem.Constant(mesh, np.array(v)) for v in (along, across))
        return weak_forms.along_and_across(ufl.FacetNormal(mesh), *values)

    def held(self, value):
        """A load (Pa) that is a vector field on the mesh, taken as it is; None for any other.

        Raises ``ValueError``, on all ranks, for a field on another mesh or of another size.
        """
        if not isinstance(value, fem.Function):
            return None
        of_grid = value.function_space.mesh is self.grid.mesh
        fits = of_grid and value.ufl_shape == (self.grid.dim,)
        message = anywhere(
            self.grid.comm,
            None
            if fits
            else f"a field on facets must be a vector on the grid's mesh, got {value!r}",
        )
        if message:
            raise ValueError(message)
        self.on_the_mesh = True
        return value

    def load(self, function: Load, placed: bool, mean: bool = False):
        """A load (Pa) as it counts in the balance or, if ``mean``, its mean over the step."""
        if placed:
            return self._fields(function, 1, lambda values: [values], mean)[0]
        f = fem.Constant(self.grid.mesh, np.zeros(self.grid.dim))
        x = np.zeros((1, self.grid.dim))

        def refresh(start: float, end: float) -> None:
            # asked for anew: in DOLFINx 0.5 the view of a constant's value does not keep the
            # constant alive
            f.value[:] = self._counted(function, start, end, x, mean)

        self._refresh.append(refresh)
        return f

    def _fields(
        self, function: Load, count: int, split: Callable, mean: bool, inward: bool = False
    ) -> list[fem.Function]:
        """So many vector fields on the cells of the facets, ``split`` from what a function of time
        and place gives; asked for a hair inside the cells, if ``inward``, where it jumps from one
        to the next."""
        V = dolfinx_versions.space(self.grid.mesh, "DQ", 2, (self.grid.dim,))
        rows = np.unique(dolfinx_versions.cell_dofs(V)[self.cells])
        x = V.tabulate_dof_coordinates()[rows, : self.grid.dim]
        x = x + INWARD * (self._centres(V)[rows] - x) if inward else x
        fields = [fem.Function(V) for _ in range(count)]

        def refresh(start: float, end: float) -> None:
            values = self._counted(function, start, end, x, mean)
            for f, value in zip(fields, split(values), strict=True):
                self.motion.nodal(f)[rows] = value

        self._refresh.append(refresh)
        return fields

    def _counted(
        self, function: Load, start: float, end: float, x: np.ndarray, mean: bool
    ) -> np.ndarray:
        """A load as it counts in the balance or, if ``mean``, its mean over the step."""
        if mean:
            return 0.5 * combined(function, start, end, x, 1.0)
        return combined(function, start, end, x, self.motion.stepping.start)

    def pressure(self, function: Load, placed: bool, mean: bool = False):
        """The load (Pa) of a pressure against the outward normal of the mesh."""

        def everywhere(t: float, x: np.ndarray) -> np.ndarray:
            return np.repeat(function(t, x), self.grid.dim, axis=-1)

        return -self.load(everywhere, placed, mean)[0] * ufl.FacetNormal(self.grid.mesh)

    def traction(self, stress: Load, mean: bool = False):
        """The traction (Pa) of a stress, rows as in ``tensors``, of time and place."""
        n, dim = ufl.FacetNormal(self.grid.mesh), self.grid.dim
        columns = self._fields(
            stress,
            dim,
            lambda rows: np.moveaxis(tensors.matrix(rows, dim), 2, 0),
            mean,
            inward=True,
        )
        return sum(column * n[j] for j, column in enumerate(columns))

    def _centres(self, V: fem.FunctionSpace) -> np.ndarray:
        """Centres (dofs, dim), m, of the cells that the values of a discontinuous field are of."""
        dofs = dolfinx_versions.cell_dofs(V)
        found = np.empty((dofs.max() + 1, self.grid.dim))
        found[dofs] = self.grid.centres[: len(dofs), None]
        return found

    def times(self, along: float, across: float, vector: Load, mean: bool = False):
        """A vector of time and place times ``tensor``."""
        return self.tensor(along, across) * self.load(vector, True, mean)

    def stored(self, along: float, across: float):
        """Traction (Pa) of springs that have accumulated the displacement so far."""
        if self._total is None:
            self._total = fem.Function(self.grid.space)
            self._before = fem.Function(self.grid.space)
        return self.tensor(along, across) * self._before

    @property
    def has_springs(self) -> bool:
        """Whether springs act on it."""
        return self._total is not None

    def take(self, others: Sequence) -> list:
        """Take over what springs on the same facets have accumulated; returns which of ``others``.

        Raises ``ValueError`` on all ranks where they are on a part of these facets only, or have
        not accumulated the same.
        """
        same = [p for p in others if self.tags & p.tags]
        if not same:
            return same
        total = same[0]._total.x.array
        whole = self.tags <= set().union(*(p.tags for p in same))
        alike = all(np.array_equal(total, p._total.x.array) for p in same)
        if anywhere(self.grid.comm, None if whole and alike else "other"):
            raise ValueError(
                f"start: on a part of the facets {self.surface.names} springs have accumulated "
                "another displacement than on the rest: give each part a term of its own"
            )
        self._total.x.array[:] = total
        return same

    def touched(self, there: np.ndarray, whole: float) -> tuple[str, float, float]:
        """What the surface is called, its area with material, and its area, of all ranks.

        ``there`` (nodes,): 1 where there is material, else 0.
        """
        where = f"the facets {', '.join(self.surface.names)}"
        return where, *on_facets(self.grid, self.surface, there)

    def far_from(self, there: np.ndarray) -> str | None:
        """Facets may lie where a body is yet to come."""
        return None

    def __str__(self) -> str:
        return f"the facets {self.surface.names}"

    def prepare(self, start: float, end: float) -> None:
        """Bring coefficients to the step."""
        if self._total is not None:
            self._before.x.array[:] = self._total.x.array
        for refresh in self._refresh:
            refresh(start, end)

    def mark(self, cells: np.ndarray) -> None:
        """Facets hold no points."""

    def mark_loaded(self, cells: np.ndarray) -> None:
        """Mark the cells of the facets with 1, unless they have more."""
        cells[self.cells] = np.maximum(cells[self.cells], 1)

    def carry(self) -> None:
        """Springs remember the step."""
        if self._total is not None:
            self._total.x.array[:] += self.motion.u.x.array

    def state(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        return {} if self._total is None else {"total": self._total.x.array}


class PointPatch:
    """A surface of points inside cells: coefficients are moment fields, integrals go over ``dx``
    and are the point sums exactly, those of ``Faces``."""

    on_the_mesh = False

    def __init__(self, points: SurfacePoints, scene):
        if points.x.shape[1] != scene.grid.dim:
            raise ValueError(
                f"on: surface points have {points.x.shape[1]} coordinates, the grid "
                f"{scene.grid.dim}"
            )
        if not scene.grid.comm.allreduce(len(points)):
            raise ValueError("on: the surface has no points")
        self.grid, self.motion = scene.grid, scene.motion
        self.surface = self.points = points
        self.tags: set[int] = set()
        self.acting: list[str] = []
        self._at_rest, self._stays = scene.at_rest, scene.plain_cells()
        self._offset = self.grid.offset.copy()  # of the grid when points were last found
        self.measure, self._cover = scene.motion.region.some(simpson(self.grid.dim))
        self._sides = scene.sides
        self.faces = Faces(self.grid, points, scene.sides)
        self._held: dict[str, np.ndarray] = {}  # loads, row by row
        self.of_its_own = False  # whether one is given for this rank's rows alone
        self.migration = Migration(self.grid) if self.grid.comm.size > 1 else None
        if self.migration is not None:
            self._leave_to_others()
        self.stencil = Stencil(self.grid, len(points), support=False)
        self._cell = self.grid.find(self._inward())
        if self.migration is None:
            self._check()
        else:
            self._destinations()
        self._refresh: list[Callable[[float, float], None]] = []

    @property
    def cells(self) -> np.ndarray:
        """The cells that the points lie in, as far as they are known."""
        return self._cell

    def _inward(self) -> np.ndarray:
        return self.faces.within(self.points.x, self.points.normal)

    def _come_in(self) -> None:
        """Faces whose centres have left through tied sides come in on the other side."""
        k, dim = self.points.per_face, self.grid.dim
        centre = self.points.x.reshape(-1, k, dim).mean(axis=1)
        self.points.x += np.repeat(self._sides.inside(centre) - centre, k, axis=0)

    def _leave_to_others(self) -> None:
        """Keep the faces that lie in this rank's cells, by their centres: what all ranks are given
        acts once."""
        points, k, grid = self.points, self.points.per_face, self.grid
        faces = len(points) // k
        x, normal = (a.reshape(faces, k, grid.dim) for a in (points.x, points.normal))
        cell = grid.find(self.faces.within(x.mean(axis=1), normal[:, 0]))
        things = np.column_stack((points.x, points.normal, points.area)).reshape(
            faces, k * (2 * grid.dim + 1)
        )
        keeper = keepers(grid.comm, things, (cell >= 0) & (cell < grid.owned_cells), cell >= 0)
        if not (keeper == grid.comm.rank).all():
            points.keep(
                (k * np.flatnonzero(keeper == grid.comm.rank)[:, None] + np.arange(k)).ravel()
            )
        points.number_together(grid.comm)

    def _destinations(self) -> tuple[np.ndarray, Destinations]:
        """Cells (faces,) of the faces' centres as far as they are known here, and where they
        belong.  Raises ``ValueError``, on all ranks, for those outside the grid."""
        points, k, grid = self.points, self.points.per_face, self.grid
        if len(self._cell) != len(points):  # another run has moved them
            self._cell = grid.find(self._inward())
            self.stencil.resize(len(points))
        x, cell = points.x.reshape(-1, k, grid.dim).mean(axis=1), self._cell[::k].copy()
        centre = self.faces.within(x, points.normal[::k])
        grid.walk(centre, cell)
        going = self.migration.destinations([(centre, cell)])
        if going.lost:
            self._refuse_lost(np.repeat(going.cells[0], k))
        return cell, going

    def _migrate(self) -> None:
        """Whole faces go to the ranks that own the cells of their centres."""
        cell, going = self._destinations()
        if not going.moving[0]:
            return
        points, k = self.points, self.points.per_face
        arrays = {
            name: value.reshape(-1, k, *value.shape[1:])
            for name, value in {**points.rows(), **self._held}.items()
        }
        found, rows, cells = self.migration.send(
            {"cell": cell, **arrays}, going.cells[0], going.far
        )
        cell = found.pop("cell")
        cell[rows] = cells
        self._cell = np.repeat(cell, k)
        self._take({name: value.reshape(-1, *value.shape[2:]) for name, value in found.items()})

    def _take(self, arrays: dict[str, np.ndarray]) -> None:
        """Other rows of the points and of what is held with them."""
        self._held = {name: arrays.pop(name) for name in self._held}
        self.points.take(arrays)
        if len(self.stencil) != len(self.points):
            self.stencil.resize(len(self.points))

    def make_room(self, rows: int) -> None:
        """So many points, whose values follow."""
        if rows != len(self.points):
            self._take(resized({**self.points.rows(), **self._held}, rows))
            self._cell = np.zeros(rows, np.int32)

    def take_points(self, arrays: dict[str, np.ndarray]) -> None:
        """Become points of other ``arrays``."""
        self._take({name: value for name, value in arrays.items() if name != "cell"})
        self._cell = self.grid.find(self._inward())

    def _lies(self, row: int, where: str) -> str:
        number = row if self.points.number is None else self.points.number[row]
        return f"surface point {number} at x={self.points.x[row]} lies {where}"

    def _check(self) -> None:
        self._refuse_lost(self._cell)

    def _refuse_lost(self, cell: np.ndarray) -> None:
        """Raise ``ValueError``, on all ranks, where a point has a cell (n,) below zero."""
        lost, message = np.flatnonzero(cell < 0), None
        if len(lost):
            message = self._lies(lost[0], "outside the grid")
            if self.migration is None:
                self._cell[lost] = 0  # whence to walk, should they be put back
        self._refuse(message)

    def _refuse(self, message: str | None) -> None:
        message = anywhere(self.grid.comm, message)
        if message:
            raise ValueError(message)

    def _field(
        self, fields: int, values: Callable[[float, float], np.ndarray]
    ) -> list[fem.Function]:
        projection = Projection(self.grid, AT_NODES, fields)

        def refresh(start: float, end: float) -> None:
            projection.clear()
            projection.add(
                self.faces.stencil,
                self.faces.spread(self.points.area[:, None] * values(start, end)),
            )
            projection.finish()

        self._refresh.append(refresh)
        return projection.fields

    def _tensors(self, along: float, across: float) -> np.ndarray:
        n = self.points.normal
        return across * np.eye(n.shape[1]) + (along - across) * n[:, :, None] * n[:, None, :]

    def tensor(self, along: float, across: float):
        """Tensor with eigenvalue ``along`` the outward normal and ``across`` it."""
        dim = self.grid.dim
        upper = np.triu_indices(dim)
        found = self._field(
            len(upper[0]), lambda *_: self._tensors(along, across)[:, upper[0], upper[1]]
        )
        at = {(i, j): f for i, j, f in zip(*upper, found, strict=True)}
        return ufl.as_tensor([[at[min(i, j), max(i, j)] for j in range(dim)] for i in range(dim)])

    def held(self, value):
        """A load (Pa) that is one row a surface point (n, dim) and moves with them; None for any
        other.

        On several ranks also one for each row that the surface was given with.  Raises
        ``ValueError``, on all ranks, for rows that do not fit, or a field on the mesh.
        """
        rows = isinstance(value, np.ndarray) and value.ndim == 2
        constant = self.points.of_given(value).copy() if rows else None
        fits = rows and constant.shape == self.points.x.shape and np.isfinite(constant).all()
        message = None
        if isinstance(value, fem.Function) or (rows and not fits):
            message = (
                f"a load on surface points must be {self.points.x.shape} finite numbers, got "
                f"{value!r}"
            )
        self._refuse(message)
        if not rows:
            return None
        name = f"held {len(self._held)}"
        self._held[name] = constant
        self.of_its_own |= len(value) != self.points.given
        return ufl.as_vector(self._field(self.grid.dim, lambda *_: self._held[name]))

    def load(self, function: Load, placed: bool, mean: bool = False):
        """A load (Pa) as it counts in the balance or, if ``mean``, its mean over the step."""

        def values(start: float, end: float) -> np.ndarray:
            x = self.points.x
            value = (
                0.5 * combined(function, start, end, x, 1.0)
                if mean
                else combined(function, start, end, x, self.motion.stepping.start)
            )
            return np.broadcast_to(value, x.shape)

        return ufl.as_vector(self._field(self.grid.dim, values))

    def pressure(self, function: Load, placed: bool, mean: bool = False):
        """The load (Pa) of a pressure against the outward normals as they are when the step
        begins."""

        def against(t: float, x: np.ndarray) -> np.ndarray:
            return -function(t, x) * self.points.normal

        return self.load(against, True, mean)

    def traction(self, stress: Load, mean: bool = False):
        """The traction (Pa) of a stress, rows as in ``tensors``, of time and place."""

        def across(t: float, x: np.ndarray) -> np.ndarray:
            rows = np.broadcast_to(stress(t, x), (len(x), stress.dim))
            return np.einsum("nij,nj->ni", tensors.matrix(rows, x.shape[1]), self.points.normal)

        return self.load(across, True, mean)

    def times(self, along: float, across: float, vector: Load, mean: bool = False):
        """A vector of time and place times ``tensor``."""

        def values(t: float, x: np.ndarray) -> np.ndarray:
            rows = np.broadcast_to(vector(t, x), x.shape)
            return np.einsum("nij,nj->ni", self._tensors(along, across), rows)

        return self.load(values, True, mean)

    def stored(self, along: float, across: float):
        """Traction (Pa) of springs that have accumulated the points' displacement so far."""
        if self.points.displacement is None:
            self.points.displacement = np.zeros_like(self.points.x)

        def values(*_) -> np.ndarray:
            return np.einsum("nij,nj->ni", self._tensors(along, across), self.points.displacement)

        return ufl.as_vector(self._field(self.grid.dim, values))

    @property
    def has_springs(self) -> bool:
        """Whether springs act on it."""
        return self.points.displacement is not None

    def take(self, others: Sequence) -> list:
        """The points carry what springs have accumulated; returns which of ``others`` are here."""
        return [p for p in others if p.points is self.points]

    def touched(self, there: np.ndarray, whole: float) -> tuple[str, float, float]:
        """What the surface is called, its area with material, and its area, of all ranks.

        ``there`` (nodes,): 1 where there is material, else 0; a point of whose neighbours less than
        ``whole`` lacks is not named.
        """
        self.locate()
        points, comm = self.points, self.grid.comm
        share = self.faces.weights @ there
        lost = np.flatnonzero(share < 1.0 - whole)
        places = comm.allgather(points.x[lost[0]] if len(lost) else None)
        first = next((str(x) for x in places if x is not None), "")
        return (
            f"surface points, as at x={first}",
            comm.allreduce(float(points.area @ share)),
            comm.allreduce(float(points.area.sum())),
        )

    def far_from(self, there: np.ndarray) -> str | None:
        """Where a point of a surface of any slope lies of which no node (nodes,) is ``there``, on
        any rank.  Found by ``touched`` before.  Collective."""
        bare = np.flatnonzero(self.faces.weights @ there <= 0.0)
        lost = str(self.points.x[bare[0]]) if self.points.cuts_cells and len(bare) else None
        return anywhere(self.grid.comm, lost)

    def __str__(self) -> str:
        return f"{len(self.points)} surface points"

    def locate(self) -> None:
        """Find the points, and cut their faces where grid lines cross them."""
        if self._stays is not None and not np.array_equal(self._offset, self.grid.offset):
            self.points.x[self._stays[self._cell]] += self.grid.offset - self._offset
            self._offset[:] = self.grid.offset
        if self._sides is not None:
            self._come_in()
        if self.migration is not None:
            self._migrate()
        self.grid.walk(self._inward(), self._cell)
        self._check()
        self.stencil.place(self.faces.brought_in(self.points.x), None, self._cell)
        self._refuse(self.faces.place(self.stencil))

    def prepare(self, start: float, end: float) -> None:
        """Find the points and bring coefficients to the step."""
        self.locate()
        self._cover(np.unique(self.faces.stencil.cell))
        for refresh in self._refresh:
            refresh(start, end)

    def mark(self, cells: np.ndarray) -> None:
        """Mark the cells that hold the points, or pieces of their faces."""
        cells[self.faces.stencil.cell] = 1

    def mark_loaded(self, cells: np.ndarray) -> None:
        """Mark the same cells with 2."""
        cells[self.faces.stencil.cell] = 2

    def carry(self) -> None:
        """Move with the grid's displacement; at rest, and in plain cells, springs remember it, and
        points stay."""
        u = self.motion.nodal(self.motion.u)
        if self._at_rest:
            if self.has_springs:
                self.points.displacement += self.stencil.at_points(u)
            return
        u, gradient = self.stencil.at_points(u), self.stencil.gradient_at_points(u)
        if self._stays is not None:
            at_rest = self._stays[self._cell]
            if self.points.displacement is not None:
                self.points.displacement[at_rest] += u[at_rest]
            u[at_rest] = gradient[at_rest] = 0.0
        self.points.follow(u, gradient)

    def state(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        if self.migration is not None:
            return {**self.points.rows(), **self._held, "cell": self._cell}
        found = {
            "x": self.points.x,
            "normal": self.points.normal,
            "area": self.points.area,
            "cell": self._cell,
        }
        more = {
            "displacement": self.points.displacement,
            "rest_area": self.points.rest_area,
            **self._held,
        }
        return {**found, **{name: value for name, value in more.items() if value is not None}}


patch.register(GridSurface)(FacetPatch)
patch.register(SurfacePoints)(PointPatch)
