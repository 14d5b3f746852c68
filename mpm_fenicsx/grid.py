"""The background grid: a dolfinx mesh, its named facets, and who lies beside whom."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import mesh as dmesh

from . import fenicsx, kernels
from .checks import finite, one_of, whole
from .lattice import SIDES, Lattice, beside
from .partition import distribute

Locator = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class GridSurface:
    """Facets on the edge of a grid: the union of named sets."""

    grid: Grid
    names: tuple[str, ...]
    tags: tuple[int, ...]

    @property
    def measure(self) -> ufl.Measure:
        """Surface measure of these facets."""
        return self.grid.ds(self.tags)

    @property
    def facets(self) -> np.ndarray:
        """Local facet indices."""
        tags = self.grid.facet_tags
        return tags.indices[np.isin(tags.values, self.tags)]


class Grid:
    """A background grid on a dolfinx mesh of quadrilaterals or hexahedra.

    ``facets`` names sets of exterior facets by functions of x (dim, n) -> bool (n,).  The sides of the bounding
    box are named already: left, right, bottom, top, and back, front in 3D.  Named sets may share facets with the
    sides but not with one another.  Raises ``ValueError`` for a name that is taken, an empty or an overlapping set.
    """

    def __init__(self, mesh, facets: Mapping[str, Locator] | None = None):
        self.mesh = mesh
        self.comm: MPI.Comm = mesh.comm
        self.dim: int = mesh.topology.dim
        self.axes = tuple(range(self.dim))
        self.space = fenicsx.space(mesh, "Lagrange", 1, (self.dim,))
        cells = mesh.topology.index_map(self.dim)
        self.owned_cells, self.cells = cells.size_local, cells.size_local + cells.num_ghosts
        self.nodes = self.space.dofmap.index_map.size_local + self.space.dofmap.index_map.num_ghosts
        self._mark(dict(facets or {}))

    # -- making one ---------------------------------------------------------------------------------------------

    @classmethod
    def box(cls, lower: Sequence[float], upper: Sequence[float], cells: Sequence[int],
            facets: Mapping[str, Locator] | None = None, comm: MPI.Comm = MPI.COMM_WORLD) -> Grid:
        """Grid of equal cells between two corners (m), in 2D or 3D.

        Raises ``ValueError`` for corners or numbers of cells that make no box.
        """
        dim = len(cells)
        if dim not in (2, 3) or len(lower) != dim or len(upper) != dim:
            raise ValueError(f"a box needs 2 or 3 of lower, upper and cells alike, got {lower}, {upper}, {cells}")
        cells = [whole("cells", n) for n in cells]
        for a, b in zip(lower, upper, strict=True):
            if finite("lower", a) >= finite("upper", b):
                raise ValueError(f"lower must lie below upper, got lower={tuple(lower)}, upper={tuple(upper)}")
        lines = [np.linspace(a, b, n + 1) for a, b, n in zip(lower, upper, cells, strict=True)]
        return cls.rectilinear(lines, facets, comm)

    @classmethod
    def rectilinear(cls, lines: Sequence[np.ndarray], facets: Mapping[str, Locator] | None = None,
                    comm: MPI.Comm = MPI.COMM_WORLD) -> Grid:
        """Grid of the cells between given grid lines, one increasing array of coordinates (m) a direction."""
        for line in lines:
            if len(line) < 2 or not np.all(np.diff(line) > 0):
                raise ValueError(f"grid lines must increase, got {line}")
        counts = [len(line) for line in lines]
        x = np.stack(np.meshgrid(*lines, indexing="ij"), -1)
        x = x.transpose(*range(len(lines))[::-1], len(lines)).reshape(-1, len(lines))  # x fastest
        strides = np.concatenate(([1], np.cumprod(counts)[:-1]))
        corner = np.zeros([n - 1 for n in counts[::-1]], dtype=np.int64)
        for d, n in enumerate(counts):
            corner += (strides[d] * np.arange(n - 1)).reshape([-1 if e == d else 1 for e in range(len(counts))][::-1])
        cells = corner.reshape(-1, 1) + kernels.digits(2, len(lines)) @ strides
        return cls(distribute(comm, x, cells), facets)

    @classmethod
    def read(cls, path, facets: Mapping[str, Locator] | None = None, comm: MPI.Comm = MPI.COMM_WORLD) -> Grid:
        """Grid of the quadrilaterals (else hexahedra) in a file that meshio reads.

        Raises ``ValueError`` for a file without such cells.
        """
        import meshio

        x, cells = np.zeros((0, 3)), np.zeros((0, 4), np.int64)
        if comm.rank == 0:
            read = meshio.read(path)
            blocks = {kind: read.get_cells_type(kind) for kind in ("hexahedron", "quad")}
            kind = next((kind for kind, found in blocks.items() if len(found)), None)
            if kind is not None:
                order = [0, 1, 3, 2] if kind == "quad" else [0, 1, 3, 2, 4, 5, 7, 6]  # ring to tensor order
                x, cells = read.points[:, : 2 if kind == "quad" else 3], blocks[kind][:, order].astype(np.int64)
                used, cells = np.unique(cells, return_inverse=True)
                x, cells = x[used], cells.reshape(-1, len(order)).astype(np.int64)
        found = comm.bcast(len(cells))
        if not found:
            raise ValueError(f"path names a file without quadrilaterals or hexahedra: {path}")
        dim = comm.bcast(x.shape[1])
        return cls(distribute(comm, x[:, :dim], cells), facets)

    # -- named facets -------------------------------------------------------------------------------------------

    def _mark(self, named: dict[str, Locator]) -> None:
        """Tag each exterior facet with the set of names that hold it, one bit a name."""
        mesh, dim = self.mesh, self.dim
        mesh.topology.create_connectivity(dim - 1, dim)
        x = mesh.geometry.x[:, :dim]
        low = np.array([self.comm.allreduce(v, MPI.MIN) for v in x.min(axis=0)])
        high = np.array([self.comm.allreduce(v, MPI.MAX) for v in x.max(axis=0)])
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

    # -- where things are ---------------------------------------------------------------------------------------

    @cached_property
    def lattice(self) -> Lattice:
        """Bounds, neighbours and patches of the cells.

        Raises ``ValueError`` for a mesh that is not rectilinear and, on several ranks, for one without all
        vertex neighbours as ghosts (``Grid.box`` and ``Grid.read`` make them).
        """
        corner = self.mesh.geometry.x[fenicsx.cell_vertices(self.mesh)][:, :, : self.dim]
        lower, upper = corner.min(axis=1), corner.max(axis=1)
        h = upper - lower
        place = (corner - lower[:, None]) / h[:, None]
        if np.abs(place - np.round(place)).max(initial=0.0) > 1e-8:
            raise ValueError("mesh must be rectilinear with axes along x, y (z) for material points, and is not")
        nodes = self.tensor_order(self.space, 1, lower, h)
        neighbour, patch = beside(lower, upper, nodes)
        self._check_ghosts(nodes)
        return Lattice(lower, upper, nodes, neighbour, patch, h.prod(axis=1))

    def tensor_order(self, V, degree: int, lower: np.ndarray | None = None,
                     h: np.ndarray | None = None) -> np.ndarray:
        """Dofs of each cell (cells, (degree + 1)^dim) in tensor order, x fastest, whatever the reference axes."""
        if lower is None:
            lower, h = self.lattice.lower, self.lattice.upper - self.lattice.lower
        dofs = fenicsx.cell_dofs(V)
        x = V.tabulate_dof_coordinates()[:, : self.dim][dofs]
        digit = np.rint(degree * (x - lower[:, None]) / h[:, None]).astype(np.int64)
        key = digit @ ((degree + 1) ** np.arange(self.dim))
        order = np.empty_like(key)
        np.put_along_axis(order, key, np.broadcast_to(np.arange(key.shape[1]), key.shape), axis=1)
        return np.take_along_axis(dofs, order.astype(dofs.dtype), axis=1)

    def find(self, x: np.ndarray) -> np.ndarray:
        """Local cell that holds each x (n, dim), m; -1 for none.  A point on an edge lies in the cell above it."""
        lattice = self.lattice
        from scipy.spatial import cKDTree

        scale = (lattice.upper - lattice.lower).max(axis=0)
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
        kernels.walk(x, cell, lattice.lower, lattice.upper, lattice.neighbour)

    @cached_property
    def _cell_field(self):
        from dolfinx import fem

        f = fem.Function(fenicsx.space(self.mesh, "DQ", 0))
        return f, fenicsx.cell_dofs(f.function_space)[:, 0]

    def share_cells(self, marks: np.ndarray) -> np.ndarray:
        """Marks of cells (cells,) with those of ghost cells taken from their owners."""
        if self.comm.size > 1:
            f, dofs = self._cell_field
            f.x.array[dofs[: self.owned_cells]] = marks[: self.owned_cells]
            fenicsx.share(f)
            marks = f.x.array[dofs].astype(marks.dtype)
        return marks

    def _check_ghosts(self, nodes: np.ndarray) -> None:
        if self.comm.size == 1:
            return
        from dolfinx import fem

        seen = fem.Function(self.space)
        here = np.bincount(nodes.ravel(), minlength=len(seen.x.array) // self.dim)
        owned = np.bincount(nodes[: self.owned_cells].ravel(), minlength=len(here))
        seen.x.array.reshape(-1, self.dim)[:] = owned[:, None]
        fenicsx.gather(seen)
        lacking = (seen.x.array.reshape(-1, self.dim)[:, 0] != here) & (owned > 0)
        if self.comm.allreduce(int(lacking.sum())):
            raise ValueError("mesh must carry all vertex neighbours as ghosts on several ranks: "
                             "make it with Grid.box or Grid.read")
