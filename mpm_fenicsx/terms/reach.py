"""Whether loads, dashpots and supports reach the material, and whether cells are full: looked at
when a run is built.

What acts on a node without material is lost: the node belongs to no body.  Of a surface that part
is lost of which the shape functions N_i belong to such nodes, 1 − Σ_i ∫ N_i dA / A over the nodes i
that have material.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx import fem

from ..common.ranks import anywhere, warn
from ..grid import dolfinx_versions
from ..grid.grid import Grid
from ..mapping.shape_functions import Stencil
from ..points.material_points import MaterialPoints
from .facets import on_facets
from .scene import Scene
from .supports import Fixed

TRACE = 1e-6
"""Of the volume around a node: with less than that of material it has none, for it is thrown about
by round-off."""
WHOLE = 1e-3
"""Of an area: what is lost beyond that is told; slivers of a body beyond a grid line lose less."""
FULL = 1e-3
"""Of a cell: what lacks less is full."""
OVERFULL = 1.4
"""Times one body, or a full cell: bodies that fill more together overlap."""


def check_reach(
    scene: Scene,
    bodies: Sequence[MaterialPoints],
    cells: Sequence[np.ndarray],
    stencils: Sequence[Stencil],
) -> None:
    """Refuse terms on surfaces that reach no material, and warn of those that reach it in part.

    Loads and dashpots are refused with ``ValueError``.  A support may be a wall that a body is yet
    to meet: in dynamics a warning names facets that hold nothing yet; in statics a support that
    does so on all its facets is refused.
    """
    acting = [patch for patch in scene.patches if patch.acting]
    if not acting and not scene.supports:
        return
    there = _nodes_with_material(scene.grid, bodies, cells, stencils)
    for part in scene.plain:
        there[part.nodes] = 1.0
    if scene.sides is not None:
        there = scene.sides.largest(there)
    for support in scene.supports:
        _check_support(scene, support, there)
    for patch in acting:
        where, touched, area = patch.touched(there, WHOLE)
        names = " and ".join(patch.acting)
        act = "act" if len(patch.acting) > 1 else "acts"
        if touched <= WHOLE * area:
            raise ValueError(
                f"on: {names} {act} on {where}, where there is no material; let the grid end "
                "where the body ends, or take the body's own surface, points.surface(side)"
            )
        lost = patch.far_from(there)
        if lost:
            raise ValueError(
                f"on: {names} {act} on a surface of which x={lost} lies farther than a cell from "
                "any material; let it run along the edge of the body, which MaterialPoints.fill(..."
                ", cut=True) ends there"
            )
        stairs = patch.points is not None and patch.points.slanted
        stairs = stairs and all(body.exposed is not None for body in bodies)
        if scene.grid.comm.allreduce(int(stairs)):
            warn(
                scene.grid.comm,
                f"{names} {act} on a slanted or curved surface, and bodies are of whole points, "
                "stairs along it, beside which stress is off by a tenth or so: "
                "MaterialPoints.fill(..., cut=True) ends them at the edge",
                3,
            )
        if touched < (1.0 - WHOLE) * area:
            unit = "m" if scene.grid.dim == 2 else "m²"
            warn(
                scene.grid.comm,
                f"{names} {act} on {where}, of which nodes with material bear "
                f"{100 * touched / area:.3g} % only, {touched:.4g} of {area:.4g} {unit}: the rest "
                "is lost",
                3,
            )


def filled(grid: Grid, bodies: Sequence[MaterialPoints], cells: Sequence[np.ndarray]) -> np.ndarray:
    """What part of each of this rank's own cells material points fill.  Collective."""
    return sum(_fill(grid, body, cell) for body, cell in zip(bodies, cells, strict=True))


def refuse_overlaps(
    grid: Grid, bodies: Sequence[MaterialPoints], cells: Sequence[np.ndarray]
) -> None:
    """Raise ``ValueError`` where bodies of one run fill a cell more than once between them, on any
    rank, or where on several ranks one that was made by hand does so alone."""
    by_hand = grid.comm.size > 1 and any(body.exposed is None for body in bodies)
    if len(bodies) < 2 and not by_hand:
        return
    fills = np.array([_fill(grid, body, cell) for body, cell in zip(bodies, cells, strict=True)])
    double = fills.sum(axis=0) > OVERFULL * np.maximum(fills.max(axis=0, initial=0.0), 1.0)
    message = None
    if double.any():
        cell = int(np.argmax(fills.sum(axis=0) * double))
        one, other = np.sort(np.argsort(-fills[:, cell])[:2])
        centre = 0.5 * (grid.lattice.lower[cell] + grid.lattice.upper[cell])
        message = (
            f"bodies {one} and {other} overlap: together they fill the cell at x={centre} "
            f"{fills[:, cell].sum():.3g} times; let each end where the other begins"
        )
    for number, (body, fill) in enumerate(zip(bodies, fills, strict=True)):
        if by_hand and body.exposed is None and fill.max(initial=0.0) > OVERFULL:
            cell = int(np.argmax(fill))
            centre = 0.5 * (grid.lattice.lower[cell] + grid.lattice.upper[cell])
            message = (
                f"body {number} fills the cell at x={centre} {fill[cell]:.3g} times: points that "
                "several ranks give count once where they are the same to the last bit, so give "
                "each on one rank, or random numbers a seed"
            )
    message = anywhere(grid.comm, message)
    if message:
        raise ValueError(message)


def _fill(grid: Grid, body: MaterialPoints, cell: np.ndarray) -> np.ndarray:
    """The part of each of this rank's own cells that support domains of a body fill."""
    volume, lattice = np.zeros(grid.cells), grid.lattice
    at = Stencil(grid, len(body), support=True)
    x = body.x if body.seat is None else body.seat  # where domains tile
    cell = cell if body.seat is None else grid.find(x)
    at.place(x, body.half, cell)
    at.add_to_cells(body.volume, volume)
    f = fem.Function(dolfinx_versions.space(grid.mesh, "DQ", 0))
    dofs = dolfinx_versions.cell_dofs(f.function_space)[:, 0]
    f.x.array[dofs] = volume
    dolfinx_versions.gather(f)
    return (f.x.array[dofs] / lattice.volume)[: grid.owned_cells]


def _check_support(scene: Scene, term: Fixed, there: np.ndarray) -> None:
    found = [
        (str(name), on_facets(scene.grid, part, there)[0]) for name, part in term.on.parts().items()
    ]
    bare = ", ".join(name for name, touched in found if touched == 0.0)
    if not bare:
        return
    if not scene.motion.stepping.dynamic and all(touched == 0.0 for _, touched in found):
        raise ValueError(
            f"on: Fixed acts on the facets {bare}, where there is no material; let the grid end "
            "where the body ends, or name facets beside it"
        )
    warn(
        scene.grid.comm,
        f"Fixed acts on the facets {bare}, where there is no material at the start: there it holds "
        "nothing until some comes",
        4,
    )


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
