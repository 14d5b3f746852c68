"""Whether loads, dashpots and supports reach the material, and whether cells are full: looked at
when a run is built.

What acts on a node without material is lost: the node belongs to no body.  Of a surface that part
is lost of which the shape functions N_i belong to such nodes, 1 − Σ_i ∫ N_i dA / A over the nodes i
that have material.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence

import numpy as np
from dolfinx import fem

from ..grid import dolfinx_versions
from ..grid.grid import Grid, GridSurface
from ..mapping.shape_functions import Stencil
from ..points.material_points import MaterialPoints
from ..points.surface_points import SurfacePoints
from .absorbing import Viscous
from .loads import Traction
from .scene import Scene
from .supports import Fixed

TRACE = 1e-6
"""Of the volume around a node: with less than that of material it has none, for it is thrown about
by round-off."""
WHOLE = 1e-3
"""Of an area: what is lost beyond that is told; slivers of a body beyond a grid line lose less."""
FULL = 1e-3
"""Of a cell: what lacks less is full."""


def check_reach(
    scene: Scene,
    terms: Sequence,
    bodies: Sequence[MaterialPoints],
    cells: Sequence[np.ndarray],
    stencils: Sequence[Stencil],
) -> None:
    """Refuse terms on surfaces that reach no material, and warn of those that reach it in part.

    Loads and dashpots are refused with ``ValueError``.  A support may be a wall that a body is yet
    to meet: in dynamics a warning names facets that hold nothing yet; in statics a support that
    does so on all its facets is refused.
    """
    acting = [term for term in terms if isinstance(term, Traction | Viscous | Fixed)]
    if not acting:
        return
    there = _nodes_with_material(scene.grid, bodies, cells, stencils)
    for term in acting:
        if isinstance(term, Fixed):
            _check_support(scene, term, there)
            continue
        where, touched, area = _touched(scene, term.on, there)
        name = type(term).__name__
        if touched <= WHOLE * area:
            raise ValueError(
                f"on: {name} acts on {where}, where there is no material; let the grid end where "
                "the body ends, or take the body's own surface, points.surface(side)"
            )
        if touched < (1.0 - WHOLE) * area:
            unit = "m" if scene.grid.dim == 2 else "m²"
            warnings.warn(
                f"{name} acts on {where}, of which nodes with material bear "
                f"{100 * touched / area:.3g} % only, {touched:.4g} of {area:.4g} {unit}: the rest "
                "is lost",
                UserWarning,
                stacklevel=3,
            )


def partly_filled(grid: Grid, bodies: Sequence[MaterialPoints], cells: Sequence[np.ndarray]) -> int:
    """How many cells are neither full nor empty, on all ranks together."""
    volume = np.zeros(grid.cells)
    lattice = grid.lattice
    for body, cell in zip(bodies, cells, strict=True):
        at = Stencil(grid, len(body), support=True)
        x = body.x if body.seat is None else body.seat  # where domains tile
        cell = cell if body.seat is None else grid.find(x)
        at.place(x, body.half, cell)
        for corner in range(2**grid.dim):
            c, part = cell.copy(), body.volume.copy()
            for d in range(grid.dim):
                s = (corner >> d) & 1
                part *= at.share[:, d, s]
                if s:
                    c = np.where(part > 0.0, lattice.neighbour[c, d, (at.side[:, d] + 1) // 2], c)
            np.add.at(volume, c[part > 0.0], part[part > 0.0])
    f = fem.Function(dolfinx_versions.space(grid.mesh, "DQ", 0))
    dofs = dolfinx_versions.cell_dofs(f.function_space)[:, 0]
    f.x.array[dofs] = volume
    dolfinx_versions.gather(f)
    fill = (f.x.array[dofs] / lattice.volume)[: grid.owned_cells]
    return grid.comm.allreduce(int(((fill > TRACE) & (fill < 1.0 - FULL)).sum()))


def _check_support(scene: Scene, term: Fixed, there: np.ndarray) -> None:
    found = [
        (name, _on_facets(scene.grid, scene.grid.facets(name), there)[0])
        for name in dict.fromkeys(term.on.names)
    ]
    bare = ", ".join(name for name, touched in found if touched == 0.0)
    if not bare:
        return
    if not scene.motion.stepping.dynamic and all(touched == 0.0 for _, touched in found):
        raise ValueError(
            f"on: Fixed acts on the facets {bare}, where there is no material; let the grid end "
            "where the body ends, or name facets beside it"
        )
    warnings.warn(
        f"Fixed acts on the facets {bare}, where there is no material at the start: there it holds "
        "nothing until some comes",
        UserWarning,
        stacklevel=4,
    )


def _touched(
    scene: Scene, on: GridSurface | SurfacePoints, there: np.ndarray
) -> tuple[str, float, float]:
    """What a surface is called, its area with material, and its area."""
    if isinstance(on, GridSurface):
        return (f"the facets {', '.join(on.names)}", *_on_facets(scene.grid, on, there))
    patch, comm = scene.patch(on), scene.grid.comm
    patch.locate()
    share = patch.faces.weights @ there
    lost = np.flatnonzero(share < 1.0 - WHOLE)
    first = next(
        (str(x) for x in comm.allgather(on.x[lost[0]] if len(lost) else None) if x is not None), ""
    )
    return (
        f"surface points, as at x={first}",
        comm.allreduce(float(on.area @ share)),
        comm.allreduce(float(on.area.sum())),
    )


def _on_facets(grid: Grid, on: GridSurface, there: np.ndarray) -> tuple[float, float]:
    """Area of facets with material, and area, of all ranks."""
    touched = area = 0.0
    for nodes, x in _facets(grid, on):
        extent = np.ptp(x, axis=0)
        whole = np.delete(extent, np.argmin(extent)).prod()
        touched, area = touched + whole * there[nodes].mean(), area + whole
    return grid.comm.allreduce(touched), grid.comm.allreduce(area)


def _facets(grid: Grid, on: GridSurface) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Nodes and their places of each facet that this rank owns."""
    topology, dim = grid.mesh.topology, grid.dim
    for pair in ((dim - 1, 0), (dim, 0)):
        topology.create_connectivity(*pair)
    vertices, corners = (topology.connectivity(d, 0) for d in (dim - 1, dim))
    node = np.zeros(
        topology.index_map(0).size_local + topology.index_map(0).num_ghosts, dtype=np.int32
    )
    node[corners.array] = dolfinx_versions.cell_dofs(
        grid.space
    ).ravel()  # the dofs of a cell come in its vertices' order
    x = grid.space.tabulate_dof_coordinates()[:, :dim]
    for facet in on.facets[on.facets < topology.index_map(dim - 1).size_local]:
        nodes = node[vertices.links(facet)]
        yield nodes, x[nodes]


def _nodes_with_material(
    grid: Grid,
    bodies: Sequence[MaterialPoints],
    cells: Sequence[np.ndarray],
    stencils: Sequence[Stencil],
) -> np.ndarray:
    """1 for nodes with material, 0 for others (nodes,), of this rank and ghosts."""
    lattice, given = grid.lattice, np.zeros((grid.nodes, 1))
    for body, cell, stencil in zip(bodies, cells, stencils, strict=True):
        stencil.place(body.x, body.half, cell)
        stencil.deposit(body.volume[:, None], given)
    full = np.zeros(grid.nodes)
    own = slice(0, grid.owned_cells)
    np.add.at(full, lattice.nodes[own], lattice.volume[own, None] / 2**grid.dim)
    sums = fem.Function(grid.space)
    columns = sums.x.array.reshape(grid.nodes, grid.dim)
    columns[:, 0], columns[:, 1] = given[:, 0], full
    dolfinx_versions.gather(sums)
    return (columns[:, 0] > TRACE * columns[:, 1]).astype(float)
