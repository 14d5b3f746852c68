"""The background grid: a dolfinx mesh, its named facets, and who lies beside whom."""

from __future__ import annotations

import errno
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import mesh as dmesh

from ..common import exchange
from ..common.checks import an_object, array, chosen, finite, increasing, one_of, several, whole
from ..common.compiled import digits
from ..common.files import failing_together
from ..common.ranks import together
from . import dolfinx_versions
from .cells import SIDES, Lattice, neighbours, patches, walk
from .kinds import Kinds, kinds_of
from .partition import distribute, distribute_anew

Locator = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class GridSurface:
    """Facets on the edge of a grid: the union of named sets."""

    grid: Grid
    names: tuple[str, ...]
    tags: tuple[int, ...]

    def parts(self) -> dict[str, GridSurface]:
        """The sets that it is the union of, by name."""
        return {name: self.grid.facets(name) for name in self.names}

    @property
    def measure(self) -> ufl.Measure:
        """Surface measure of these facets."""
        return self.grid.ds(self.tags)

    @property
    def facets(self) -> np.ndarray:
        """Local facet indices."""
        tags = self.grid.facet_tags
        return tags.indices[np.isin(tags.values, self.tags)]


@dataclass(frozen=True)
class InnerFacets(GridSurface):
    """Facets inside a grid, for supports: loads and dashpots there act on ``SurfacePoints``."""

    where: Locator

    def parts(self) -> dict[str, GridSurface]:
        """All of it."""
        return {"inside the grid": self}

    @property
    def measure(self) -> ufl.Measure:
        """None: a facet between cells belongs to both."""
        raise ValueError(
            "on: facets inside the grid are for Fixed; loads, dashpots and springs there act on "
            "surface points, SurfacePoints or points.surface(side)"
        )

    @property
    def facets(self) -> np.ndarray:
        """Local facet indices."""
        mesh, dim = self.grid.mesh, self.grid.dim
        mesh.topology.create_entities(dim - 1)
        with together(self.grid.comm, Exception):
            return dmesh.locate_entities(
                mesh, dim - 1, lambda x: chosen("where", self.where, x[:dim])
            )


class Grid:
    """A background grid on a dolfinx mesh of quadrilaterals or hexahedra.

    ``facets`` names sets of exterior facets by functions of x (dim, n) -> bool (n,).  The sides of
    the bounding box are named already: left, right, bottom, top, and back, front in 3D.  Named sets
    may share facets with the sides but not with one another.
    Raises ``ValueError`` for a name that is taken, an empty or an overlapping set.
    """

    def __init__(self, mesh, facets: Mapping[str, Locator] | None = None):
        _refuse_other_meshes(mesh)
        self._named = _locators(facets or {})
        self.weight: np.ndarray | None = None  # (owned cells,): by which it was cut anew
        self.comm: MPI.Comm = mesh.comm  # as long as the mesh lives; see ``_on``
        self._of_mesh = True
        self.offset = np.zeros(mesh.topology.dim)  # m: how far ``move_to`` has moved it
        self._made: list[np.ndarray] | None = None
        self._same: Callable | None = None  # from nodes to those of which they are copies
        self._lie_on(mesh)

    def _lie_on(self, mesh) -> None:
        """Take a mesh, and mark its facets."""
        self.mesh = mesh
        self.dim: int = mesh.topology.dim
        self.axes = tuple(range(self.dim))
        self.space = dolfinx_versions.space(mesh, "Lagrange", 1, (self.dim,))
        cells = mesh.topology.index_map(self.dim)
        self.owned_cells, self.cells = cells.size_local, cells.size_local + cells.num_ghosts
        self.nodes = self.space.dofmap.index_map.size_local + self.space.dofmap.index_map.num_ghosts
        self._mark(self._named)

    def __repr__(self) -> str:
        cells = self.mesh.topology.index_map(self.dim).size_global
        lower, upper = (
            f"({', '.join(f'{a:.6g}' for a in corner)})"
            for corner in (self.lower_corner, self.upper_corner)
        )
        return f"Grid({cells} cells in {self.dim}D, corners {lower} and {upper} m)"

    # -- making one --------------------------------------------------------------------------------

    @classmethod
    def box(
        cls,
        lower: Sequence[float],
        upper: Sequence[float],
        cells: Sequence[int],
        facets: Mapping[str, Locator] | None = None,
        comm: MPI.Comm = MPI.COMM_WORLD,
        periodic: str = "",
    ) -> Grid:
        """Grid of equal cells between two corners (m), in 2D or 3D.

        ``facets``: names for parts of the grid's outer edge, each with a function of x (dim, n), m,
        -> bool (n,), such as ``{"strip": lambda x: (x[1] > 2 - 1e-9) & (x[0] < 1 + 1e-9)}``; a
        facet belongs to a part with all its corners, and facets inside the grid are never taken.
        ``grid.facets("strip")`` is then the part.
        ``periodic``: directions, such as "x" or "xy", in which ranks know the cells over the sides,
        too, as ``Tied`` wants it for material points on several ranks; on one rank it says nothing.
        Raises ``ValueError`` for corners or numbers of cells that make no box, and as ``Grid`` does
        for ``facets``.
        """
        given = [np.shape(v) for v in (lower, upper, cells)]
        if given[0] not in ((2,), (3,)) or len(set(given)) > 1:
            raise ValueError(
                "a box needs 2 or 3 of lower, upper and cells alike, such as Grid.box((0, 0), (2, "
                f"1), (20, 10)), got {lower}, {upper}, {cells}"
            )
        cells = [whole("cells", n) for n in cells]
        for a, b in zip(lower, upper, strict=True):
            if finite("lower", a) >= finite("upper", b):
                raise ValueError(
                    f"lower must lie below upper, got lower={tuple(lower)}, upper={tuple(upper)}"
                )
        lines = [np.linspace(a, b, n + 1) for a, b, n in zip(lower, upper, cells, strict=True)]
        return cls.rectilinear(lines, facets, comm, periodic)

    @classmethod
    def rectilinear(
        cls,
        lines: Sequence[np.ndarray],
        facets: Mapping[str, Locator] | None = None,
        comm: MPI.Comm = MPI.COMM_WORLD,
        periodic: str = "",
    ) -> Grid:
        """Grid of the cells between given grid lines, one increasing array of coordinates (m) a
        direction.  ``periodic`` as in ``box``."""
        an_object("comm", comm, MPI.Comm, "an MPI communicator")
        lines = [
            increasing("grid lines", line)
            for line in several(
                "lines",
                lines,
                "an array of coordinates a direction, such as [[0, 1, 2], [0, 0.5, 1]]",
            )
        ]
        if len(lines) not in (2, 3):
            raise ValueError(f"lines must be arrays of 2 or 3 directions, got {len(lines)}")
        x = np.stack([line[i] for line, i in zip(lines, _slice(comm, lines, 0), strict=True)], 1)
        strides = np.cumprod([1, *map(len, lines[:-1])])
        corner = sum(n * i for n, i in zip(strides, _slice(comm, lines, 1), strict=True))
        cells = corner[:, None] + digits(2, len(lines)) @ strides
        same = _copies(list(map(len, lines)), periodic)
        grid = cls(distribute(comm, x, cells, same), facets)._on(comm)
        grid._same = same
        return grid

    @classmethod
    def read(
        cls, path, facets: Mapping[str, Locator] | None = None, comm: MPI.Comm = MPI.COMM_WORLD
    ) -> Grid:
        """Grid of the quadrilaterals (else hexahedra) in a file that meshio reads.

        Raises ``ValueError`` for a file without such cells, or whose quadrilaterals do not lie in
        the xy plane; ``OSError``, on every rank, for one that cannot be read.
        """
        an_object("comm", comm, MPI.Comm, "an MPI communicator")
        x, cells, fault = np.zeros((0, 3)), np.zeros((0, 4), np.int64), None
        with failing_together(comm, "grid not read", path):
            read = _read(path) if comm.rank == 0 else None
        if read is not None:
            blocks = {kind: read.get_cells_type(kind) for kind in ("hexahedron", "quad")}
            kind = next((kind for kind, found in blocks.items() if len(found)), None)
            if kind is not None:
                order = (
                    [0, 1, 3, 2] if kind == "quad" else [0, 1, 3, 2, 4, 5, 7, 6]
                )  # ring to tensor order
                x = read.points[:, : 2 if kind == "quad" else 3]
                cells = blocks[kind][:, order].astype(np.int64)
                used, cells = np.unique(cells, return_inverse=True)
                x, cells = x[used], cells.reshape(-1, len(order)).astype(np.int64)
                fault = _out_of_plane(read.points[used]) if kind == "quad" else None
        fault = comm.bcast(
            fault if len(cells) else "names a file without quadrilaterals or hexahedra"
        )
        if fault:
            raise ValueError(f"path {fault}: {path}")
        x, cells = (exchange.scatter(comm, of_file) for of_file in (x, cells))
        return cls(distribute(comm, x, cells), facets)._on(comm)

    def _on(self, comm: MPI.Comm) -> Grid:
        """The grid with a communicator that lives longer than its mesh."""
        self.comm, self._of_mesh = comm, False
        return self

    # -- who owns what -----------------------------------------------------------------------------

    def repartition(self, weight: np.ndarray) -> None:
        """Cut the grid anew, so that the cells of each rank weigh as much; in place.

        ``weight`` (owned cells,) >= 0: what each cell costs, such as 1 + points in it; cells that
        weigh nothing go anywhere.  The grid has another mesh then, with other local numbers of
        cells, nodes and facets, and other ghosts: what was made from the former ones (spaces,
        fields, forms, measures, ``lattice``) is to be made anew.
        What ``facets`` has returned, ``cell_numbers``, ``node_numbers`` and ``facet_numbers`` go on
        saying the same of the same cells, nodes and facets.  Collective.
        Raises ``ValueError``, on all ranks, for weights that are none.
        """
        with together(self.comm):
            weight = _weights(weight, self.owned_cells)
        neighbours, offset = self.__dict__.get("neighbours"), self.offset.copy()
        self.move_to(np.zeros(self.dim))
        self._made = None
        number = self.cell_numbers[: self.owned_cells]
        mesh = distribute_anew(self.mesh, number, weight, self._same)
        if self._of_mesh:
            self._on(self.comm.Dup())
        if neighbours is not None:
            neighbours[1].Free()
        for name, of_class in vars(type(self)).items():
            if isinstance(of_class, cached_property):
                self.__dict__.pop(name, None)
        self._lie_on(mesh)
        asked = self.cell_numbers[: self.owned_cells]
        self.move_to(offset)
        self.weight = exchange.fetched(self.comm, number, {"weight": weight}, asked)["weight"]

    def move_to(self, offset: np.ndarray) -> None:
        """Lie ``offset`` (dim,), m, from where the grid was made: all of it moves, in place, and
        what is on it with it."""
        if np.array_equal(offset, self.offset):
            return
        self.offset[:] = offset
        if self._made is None:
            self._made = self._moving(np.copy)
        for places, made in zip(self._moving(lambda places: places), self._made, strict=True):
            places[:, : self.dim] = made[:, : self.dim] + offset

    @contextmanager
    def where_made(self) -> Iterator[None]:
        """Within, the grid lies where it was made, so that what is integrated is the same to the
        last bit wherever it has come to."""
        offset = self.offset.copy()
        self.move_to(np.zeros(self.dim))
        try:
            yield
        finally:
            self.move_to(offset)

    def _moving(self, of: Callable) -> list[np.ndarray]:
        """``of`` each array of places that moves with the grid."""
        corners = self.lower_corner[None], self.upper_corner[None]
        return [of(a) for a in (self.mesh.geometry.x, *self._bounds[:2], *corners)]

    @property
    def made_at(self) -> np.ndarray:
        """Places of the mesh's nodes (nodes, dim), m, where the grid was made."""
        return (self.mesh.geometry.x if self._made is None else self._made[0])[:, : self.dim]

    @cached_property
    def neighbours(self) -> tuple[np.ndarray, MPI.Distgraphcomm]:
        """Ranks that have ghosts of this one's cells or cells of which it has ghosts, and a
        communicator of such, until the grid is partitioned anew.  Collective when it is first asked
        for."""
        cells = self.mesh.topology.index_map(self.dim)
        first = np.array(self.comm.allgather(int(cells.local_range[0])))
        ghosts = dolfinx_versions.global_numbers(cells)[self.owned_cells :]
        asked = np.unique(np.searchsorted(first, ghosts, side="right") - 1)
        askers, _ = exchange.send(self.comm, np.full((len(asked), 1), self.comm.rank), asked)
        beside = np.union1d(asked, askers[:, 0]).astype(int)
        return beside, self.comm.Create_dist_graph_adjacent(beside, beside)

    # -- named facets ------------------------------------------------------------------------------

    def _mark(self, named: dict[str, Locator]) -> None:
        """Tag each exterior facet with the set of names that hold it, one bit a name."""
        mesh, dim = self.mesh, self.dim
        mesh.topology.create_connectivity(dim - 1, dim)
        x = mesh.geometry.x[:, :dim]
        low = np.array([self.comm.allreduce(v, MPI.MIN) for v in x.min(axis=0, initial=np.inf)])
        high = np.array([self.comm.allreduce(v, MPI.MAX) for v in x.max(axis=0, initial=-np.inf)])
        self.lower_corner, self.upper_corner = low, high
        tolerance = 1e-10 * (high - low).max()
        sets: dict[str, Locator] = {}
        for name, (d, end) in SIDES.items():
            if d < dim:
                at = (low, high)[end][d]
                sets[name] = lambda y, d=d, at=at: np.abs(y[d] - at) < tolerance
        taken = sorted(set(named) & set(sets))
        if taken:
            raise ValueError(f"facets: the name {taken[0]!r} is taken by a side of the grid")
        facet_map = mesh.topology.index_map(dim - 1)
        mask = np.zeros(facet_map.size_local + facet_map.num_ghosts, dtype=np.int64)
        count = np.zeros(len(mask), dtype=np.int64)
        self._bits = {}
        for bit, (name, locate) in enumerate({**sets, **named}.items()):
            with together(self.comm, Exception):
                found = dmesh.locate_entities_boundary(mesh, dim - 1, locate)
            if name in named and not self.comm.allreduce(len(found)):
                raise ValueError(f"facets: the set {name!r} is empty")
            mask[found] |= 1 << bit
            count[found] += name in named
            self._bits[name] = 1 << bit
        if self.comm.allreduce(int((count > 1).sum())):
            raise ValueError(f"facets: the sets {sorted(named)} overlap")
        marked = np.flatnonzero(mask).astype(np.int32)
        self.facet_tags = dmesh.meshtags(mesh, dim - 1, marked, mask[marked].astype(np.int32))
        local = set(mask[marked].tolist())
        self._tags = sorted(set().union(*self.comm.allgather(local)))
        self.ds = ufl.Measure("ds", domain=mesh, subdomain_data=self.facet_tags)
        self.dx = ufl.Measure("dx", domain=mesh)

    def facets(self, *names: str) -> GridSurface:
        """The union of named facet sets.  Raises ``ValueError`` for a name that is not known."""
        bits = 0
        for name in names:
            bits |= self._bits[one_of("facets", name, self._bits)]
        tags = tuple(tag for tag in self._tags if tag & bits)
        if not tags:
            raise ValueError(f"facets: {names} holds no facet")
        return GridSurface(self, names, tags)

    def inner_facets(self, where: Locator) -> InnerFacets:
        """Facets between cells all corners x (dim, n), m, of which lie ``where`` says, bool (n,):
        lines of the grid at which Fixed can hold a body that ends there.

        Raises ``ValueError`` for none.
        """
        found = InnerFacets(self, ("inner",), (), where)
        if not self.comm.allreduce(len(found.facets)):
            raise ValueError("where: no facet of the grid lies there with all its corners")
        return found

    # -- where things are --------------------------------------------------------------------------

    @cached_property
    def lattice(self) -> Lattice:
        """Bounds, neighbours and patches of the cells.

        Raises ``ValueError`` for a mesh that is not rectilinear and, on several ranks, for one
        without all vertex neighbours as ghosts (``Grid.box`` and ``Grid.read`` make them).
        """
        lower, upper, rectilinear = self._bounds
        if not rectilinear:
            raise ValueError(
                "mesh must be rectilinear with axes along x, y (z) for material points, and is not"
            )
        h = upper - lower
        nodes = self.tensor_order(self.space, 1, lower, h)
        neighbour = neighbours(nodes, self.dim)
        patch = patches(neighbour, nodes)
        self._check_ghosts(nodes)
        return Lattice(lower, upper, nodes, neighbour, patch, h.prod(axis=1), h)

    @cached_property
    def _bounds(self) -> tuple[np.ndarray, np.ndarray, bool]:
        """Lower and upper corners (cells, dim), m, and whether the cells of all ranks fill them.
        Collective when it is first asked for."""
        corner = self.mesh.geometry.x[dolfinx_versions.cell_vertices(self.mesh)][:, :, : self.dim]
        lower, upper = corner.min(axis=1), corner.max(axis=1)
        place = (corner - lower[:, None]) / (upper - lower)[:, None]
        uneven = float(np.abs(place - np.round(place)).max(initial=0.0))
        return lower, upper, self.comm.allreduce(uneven, op=MPI.MAX) <= 1e-8

    @cached_property
    def kinds(self) -> Kinds | None:
        """Kinds of this rank's cells and ghosts, each of one size, where all are boxes."""
        return kinds_of(self.made_at[dolfinx_versions.cell_vertices(self.mesh)])

    @cached_property
    def centres(self) -> np.ndarray:
        """Centres (cells, dim), m, of this rank's cells and ghosts, where the grid was made."""
        return self.made_at[dolfinx_versions.cell_vertices(self.mesh)].mean(axis=1)

    def tensor_order(
        self, V, degree: int, lower: np.ndarray | None = None, h: np.ndarray | None = None
    ) -> np.ndarray:
        """Dofs of each cell (cells, (degree + 1)^dim) in tensor order, x fastest, whatever the
        reference axes."""
        if lower is None:
            lower, h = self.lattice.lower, self.lattice.upper - self.lattice.lower
        dofs = dolfinx_versions.cell_dofs(V)
        x = V.tabulate_dof_coordinates()[:, : self.dim][dofs]
        digit = np.rint(degree * (x - lower[:, None]) / h[:, None]).astype(np.int64)
        key = digit @ ((degree + 1) ** np.arange(self.dim))
        order = np.empty_like(key)
        np.put_along_axis(order, key, np.broadcast_to(np.arange(key.shape[1]), key.shape), axis=1)
        return np.take_along_axis(dofs, order.astype(dofs.dtype), axis=1)

    def find(self, x: np.ndarray) -> np.ndarray:
        """Local cell that holds each x (n, dim), m; -1 for none.  A point on an edge lies in the
        cell above it."""
        lattice = self.lattice
        from scipy.spatial import cKDTree

        scale = (lattice.upper - lattice.lower).max(axis=0, initial=np.finfo(float).tiny)
        centre = 0.5 * (lattice.lower + lattice.upper)
        cell = np.full(len(x), -1, dtype=np.int32)
        ok = np.isfinite(x).all(axis=1)
        if ok.any() and self.cells:
            cell[ok] = cKDTree(centre / scale).query(x[ok] / scale)[1]
        self.walk(x, cell)
        return cell

    def walk(self, x: np.ndarray, cell: np.ndarray) -> None:
        """Update ``cell`` (n,) in place for points that have moved to x (n, dim)."""
        lattice = self.lattice
        walk(x, cell, lattice.lower, lattice.upper, lattice.neighbour)

    def share_cells(self, marks: np.ndarray) -> np.ndarray:
        """Marks of cells (cells,) with those of ghost cells taken from their owners."""
        if self.comm.size > 1:
            f, dofs = self._of_cells
            f.x.array[dofs] = marks
            dolfinx_versions.share(f)
            marks = f.x.array[dofs].astype(marks.dtype)
        return marks

    def marked_anywhere(self, marks: np.ndarray) -> np.ndarray:
        """Which cells (cells,), bool, are marked on any rank, as its own or as a ghost."""
        if self.comm.size == 1:
            return marks.astype(bool)
        f, dofs = self._of_cells
        f.x.array[dofs] = marks != 0
        dolfinx_versions.gather(f)
        return f.x.array[dofs] > 0.0

    def most_anywhere(self, marks: np.ndarray) -> np.ndarray:
        """The largest of each cell's marks (cells,), 0, 1 or 2, on all ranks that know it."""
        if self.comm.size == 1:
            return marks
        least, most = (self.marked_anywhere(marks >= mark) for mark in (1, 2))
        return least.astype(marks.dtype) + most

    @cached_property
    def index(self) -> np.ndarray:
        """Which cell along each direction (cells, dim) each is, from 0 on: the same on any number
        of ranks.

        Collective when it is first asked for.
        """
        return self._places(self.lattice.lower)

    @cached_property
    def cell_numbers(self) -> np.ndarray:
        """One number (cells,) for each cell, the same on any number of ranks and however it is
        partitioned: by its ``index``, with gaps where the grid is no box; of a grid that is not
        rectilinear the one that it had in the mesh's input.  Collective when it is first asked
        for."""
        lower, _, rectilinear = self._bounds
        return (
            self._numbered(self._places(lower))
            if rectilinear
            else dolfinx_versions.input_numbers(self.mesh)[0]
        )

    @cached_property
    def node_numbers(self) -> np.ndarray:
        """One number (nodes,) for each node, a block of ``space``, the same on any number of ranks
        and however the grid is partitioned: as ``cell_numbers`` are.  Collective when it is first
        asked for."""
        number = (
            self._numbered(self._places(self.mesh.geometry.x[:, : self.dim]))
            if self._bounds[2]
            else dolfinx_versions.input_numbers(self.mesh)[1]
        )
        out = np.empty(self.nodes, dtype=np.int64)
        out[dolfinx_versions.cell_dofs(self.space)] = number[
            dolfinx_versions.cell_vertices(self.mesh)
        ]
        return out

    @cached_property
    def facet_numbers(self) -> np.ndarray:
        """One number for each local and ghost facet: 2 dim times that of its cell, of the one with
        the lesser number where it lies between two that this rank knows, and which of the cell's
        facets it is.

        The same for the facets of a rank's own cells on any number of ranks and however the grid is
        partitioned.  Collective when it is first asked for.
        """
        topology, sides = self.mesh.topology, 2 * self.dim
        topology.create_connectivity(self.dim, self.dim - 1)
        of_cells = np.asarray(topology.connectivity(self.dim, self.dim - 1).array)
        facets = topology.index_map(self.dim - 1)
        out = np.full(facets.size_local + facets.num_ghosts, np.iinfo(np.int64).max)
        number = (sides * self.cell_numbers[:, None] + np.arange(sides)).ravel()
        np.minimum.at(out, of_cells, number)
        return out

    def _places(self, x: np.ndarray) -> np.ndarray:
        """Which of all coordinates along each direction, on all ranks, those of x (n, dim), m, are,
        from 0 on (n, dim).  Collective."""
        hair, out = 1e-6 * self.smallest, np.empty(x.shape, dtype=np.int64)
        for d in range(self.dim):
            line = np.unique(np.concatenate(self.comm.allgather(np.unique(x[:, d]))))
            number = np.concatenate(
                ([0], np.cumsum(np.diff(line) > hair))
            )  # places a hair apart are one line
            out[:, d] = number[np.searchsorted(line, x[:, d])]
        return out

    def _numbered(self, index: np.ndarray) -> np.ndarray:
        """One number (n,) for each index (n, dim), the first direction fastest.  Collective."""
        most = 1 + np.array(self.comm.allgather(index.max(axis=0, initial=-1))).max(axis=0)
        return index @ np.concatenate(([1], np.cumprod(most[:-1])))

    @cached_property
    def smallest(self) -> float:
        """Least extent (m) of any cell on any rank.  Collective when it is first asked for."""
        lower, upper, _ = self._bounds
        return self.comm.allreduce(float((upper - lower).min(initial=np.inf)), op=MPI.MIN)

    @cached_property
    def _of_cells(self):
        """A field of one number a cell, and its dofs (cells,)."""
        from dolfinx import fem

        f = fem.Function(dolfinx_versions.space(self.mesh, "DQ", 0))
        return f, dolfinx_versions.cell_dofs(f.function_space)[:, 0]

    def _check_ghosts(self, nodes: np.ndarray) -> None:
        if self.comm.size == 1:
            return
        from dolfinx import fem

        seen = fem.Function(self.space)
        here = np.bincount(nodes.ravel(), minlength=len(seen.x.array) // self.dim)
        owned = np.bincount(nodes[: self.owned_cells].ravel(), minlength=len(here))
        seen.x.array.reshape(-1, self.dim)[:] = owned[:, None]
        dolfinx_versions.gather(seen)
        lacking = (seen.x.array.reshape(-1, self.dim)[:, 0] != here) & (owned > 0)
        if self.comm.allreduce(int(lacking.sum())):
            raise ValueError(
                "mesh must carry all vertex neighbours as ghosts on several ranks: make it with "
                "Grid.box or Grid.read"
            )


def _slice(comm: MPI.Comm, lines: Sequence[np.ndarray], less: int) -> Sequence[np.ndarray]:
    """This rank's share of the places of a lattice with so many ``less`` than lines, as one array
    of indices a direction, x fastest."""
    counts = [len(line) - less for line in lines]
    here = np.arange(*exchange.slice_of(comm, math.prod(counts)))
    return np.unravel_index(here, counts[::-1])[::-1]


def _copies(counts: Sequence[int], periodic: str) -> Callable[[np.ndarray], np.ndarray] | None:
    """From numbers of nodes of a lattice of so many lines to those of which they are copies where
    it goes on over its sides; None where it does not."""
    axes = "xyz"[: len(counts)]
    for c in periodic:
        one_of("periodic", c, axes)
    if not periodic:
        return None
    strides = np.cumprod([1, *counts[:-1]])
    period = [n - 1 if c in periodic else n for n, c in zip(counts, axes, strict=True)]

    def same(number: np.ndarray) -> np.ndarray:
        index = number[..., None] // strides % counts
        return (index % period) @ strides

    return same


def _weights(weight: np.ndarray, cells: int) -> np.ndarray:
    """Weights of cells as floats, or ``ValueError`` for what is none."""
    found = array("weight", weight)
    if found.shape != (cells,):
        raise ValueError(
            f"weight must be one number for each of this rank's {cells} own cells, got an array of "
            f"shape {found.shape}"
        )
    wrong = found[~((found >= 0.0) & np.isfinite(found))]
    if len(wrong):
        raise ValueError(f"weight must be finite and not negative, got {wrong[0]}")
    return found


def _read(path):
    """The mesh in a file that meshio knows."""
    import meshio

    try:
        return meshio.read(path)
    except SystemExit:  # what meshio does where no reader of the file's kind takes it
        raise OSError(errno.EINVAL, "meshio cannot read it") from None


def _out_of_plane(x: np.ndarray) -> str | None:
    """What is wrong with quadrilaterals whose corners x (n, 2 or 3), m, do not lie in a plane z =
    const."""
    extent = np.ptp(x, axis=0)
    if len(extent) < 3 or extent[2] <= 1e-9 * extent.max():
        return None
    flat = [axis for axis, e in zip("xyz", extent, strict=True) if e <= 1e-9 * extent.max()]
    where = (
        f"in the {'xyz'.replace(flat[0], '')} plane"
        if flat
        else f"on a surface in space, {extent} m wide"
    )
    return (
        f"names a file whose quadrilaterals lie {where}; a grid in 2D lies in the xy plane, so "
        "turn the mesh"
    )


def _refuse_other_meshes(mesh) -> None:
    """Raise ``ValueError`` for what is no flat mesh of bilinear quadrilaterals or of trilinear
    hexahedra."""
    if not {"comm", "topology", "geometry"} <= set(dir(mesh)):
        raise ValueError(
            f"mesh must be a dolfinx mesh, got {mesh!r}; Grid.box and Grid.read make one"
        )
    dim, kind = mesh.topology.dim, str(mesh.topology.cell_name())
    if kind not in ("quadrilateral", "hexahedron"):
        raise ValueError(
            f"mesh must be of quadrilaterals or hexahedra, got cells of the kind {kind}"
        )
    if mesh.geometry.dim != dim:
        raise ValueError(
            f"mesh must lie in the xy plane, got {kind} cells in {mesh.geometry.dim}D space"
        )
    cells = mesh.topology.index_map(dim)
    if dolfinx_versions.cell_vertices(mesh).shape[0] != cells.size_local + cells.num_ghosts:
        raise ValueError(
            f"mesh must have {2**dim} nodes a cell (of degree 1), got curved cells of more"
        )


def _locators(facets: Mapping[str, Locator]) -> dict[str, Locator]:
    """Named functions of x, whose answers are told apart from arrays that are none."""
    an_object(
        "facets", facets, Mapping, 'functions of x by name, such as {"footing": lambda x: x[0] < 1}'
    )

    def named(name: str, locate: Locator) -> Locator:
        if not callable(locate):
            raise ValueError(f"facets: {name!r} must be a function of x (dim, n), got {locate!r}")
        return lambda x: chosen(f"facets: {name!r}", locate, x)

    return {str(name): named(name, locate) for name, locate in facets.items()}
