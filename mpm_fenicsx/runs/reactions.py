"""Reactions of fixed edges as tractions, for surfaces that are to bear them when the fixities are
gone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem
from scipy.sparse import csr_matrix, vstack
from scipy.sparse.linalg import lsqr, spsolve

from ..grid import dolfinx_versions
from ..grid.grid import Grid, GridSurface
from ..mapping.ties import Ties
from ..points.surface_points import SurfacePoints
from ..terms.boundary_patches import PointPatch
from ..terms.loads import Traction
from ..terms.scene import Scene

HAIR = 1e-6  # of a surface point's weight: so much may lie on nodes that are not fixed
EXACT = 1e-8  # of the reactions: what tractions may miss


def tractions(
    scene: Scene, fixed: np.ndarray, borne: np.ndarray, surfaces: Sequence, ties: Ties | None = None
) -> list[Traction]:
    """Tractions t on ``surfaces`` with Σ_m A_m N_i(x_m) t_m, or ∫ N_i t ds on facets, equal to the
    reactions R_i.

    ``fixed``, ``borne`` (dofs,): which are, and R, N.  A component of t is there only on edges
    where it is fixed; of all such t the one with the least ∫ t².  What fixed nodes bear that the
    surfaces do not touch is left out: it belongs to supports that stay.  Surface points must lie on
    the grid lines: make them after the static run, or before it and let a term carry them along (as
    they must be where the material points are scattered). ``ties``: those of the run; light nodes
    that are fixed beside a surface, which does not touch them, hand what they bear to the nodes of
    it that they will be tied to.
    Raises ``ValueError`` on several ranks, for surfaces of both kinds or none, one that is on no
    fixed edge, or too few surface points.
    """
    if scene.grid.comm.size > 1:
        raise ValueError("reactions are found on one rank only")
    fixed, borne = (a.reshape(-1, scene.grid.dim) for a in (fixed, borne))
    for kind, find in ((SurfacePoints, _at_points), (GridSurface, _on_facets)):
        if surfaces and all(isinstance(surface, kind) for surface in surfaces):
            found = find(scene, fixed, borne, surfaces, ties)
            return [
                Traction(surface, value) for surface, value in zip(surfaces, found, strict=True)
            ]
    raise ValueError(
        f"surfaces must all be surface points, or all facets of the grid, got {surfaces!r}"
    )


def _at_points(
    scene: Scene, fixed: np.ndarray, borne: np.ndarray, surfaces: Sequence, ties: Ties | None
) -> list[np.ndarray]:
    patches = [PointPatch(surface, scene) for surface in surfaces]
    for patch in patches:
        patch.prepare(0.0, 0.0)
    weights = vstack([patch.faces.weights for patch in patches], format="csr")  # (points, nodes)
    root = np.sqrt(np.concatenate([surface.area for surface in surfaces]))
    free = abs(weights) @ (~fixed).astype(float)
    there = free <= HAIR  # (points, dim)
    cuts = np.cumsum([len(surface) for surface in surfaces])[:-1]
    _refuse_free([part.any() for part in np.split(there, cuts)])
    t = np.zeros(there.shape)
    for c in range(t.shape[1]):
        rows = np.flatnonzero(there[:, c])
        if not len(rows):
            continue
        mine = weights[rows]
        A = csr_matrix(mine.multiply(root[rows, None])).T.tocsr()
        reached = np.asarray(mine.sum(axis=0)).ravel() > HAIR
        touched, R = np.flatnonzero(reached), borne[:, c]
        if ties is not None:
            R = ties.hand_over(R, fixed[:, c] & ~reached, fixed[:, c] & reached)
        A, R = A[touched], R[touched]
        scale = 1.0 / np.sqrt(np.asarray(A.multiply(A).sum(axis=1)).ravel())
        B = csr_matrix(A.multiply(scale[:, None]))
        y = lsqr(B, scale * R, atol=1e-15, btol=1e-15, conlim=0.0, iter_lim=50 * len(rows))[0]
        miss = np.abs(A @ y - R).max() / max(np.abs(borne).max(), np.finfo(float).tiny)
        if not miss <= EXACT:
            raise ValueError(
                f"surfaces: their points are too few for the reactions, {miss:.1e} of which they "
                "miss"
            )
        t[rows, c] = y / root[rows]
    return np.split(t, cuts)


def _on_facets(
    scene: Scene, fixed: np.ndarray, borne: np.ndarray, surfaces: Sequence, ties: Ties | None
) -> list[fem.Function]:
    grid, mesh, dim = scene.grid, scene.grid.mesh, scene.grid.dim
    marks = dolfinx_versions.space(mesh, "DQ", 0, (dim,))
    at = dolfinx_versions.cell_dofs(marks)[:, 0]
    there = [_marks(grid, surface, fixed) for surface in surfaces]  # (cells, dim) each
    _refuse_free([part.any() for part in there])
    u, w, mass = ufl.TrialFunction(grid.space), ufl.TestFunction(grid.space), 0
    for surface, part in zip(surfaces, there, strict=True):
        mark = fem.Function(marks)
        mark.x.array.reshape(-1, dim)[at] = part
        mass += sum(mark[c] * u[c] * w[c] for c in range(dim)) * surface.measure
    form = dolfinx_versions.compile_form(mass)
    A = dolfinx_versions.create_matrix(form)
    dolfinx_versions.assemble_matrix(A, form, [])
    A.assemble()
    start, column, value = A.getValuesCSR()
    M = csr_matrix((value, column, start), shape=A.getSize())
    touched = np.flatnonzero(M.diagonal() > 0.0)
    λ = fem.Function(grid.space)
    λ.x.array[touched] = spsolve(M[touched][:, touched].tocsc(), borne.ravel()[touched])
    V, found = dolfinx_versions.space(mesh, "DQ", 1, (dim,)), []
    for part in there:
        t = fem.Function(V, name="reaction")
        t.interpolate(λ)
        t.x.array.reshape(-1, dim)[dolfinx_versions.cell_dofs(V)] *= part[:, None]
        found.append(t)
    return found


def _marks(grid: Grid, surface: GridSurface, fixed: np.ndarray) -> np.ndarray:
    """Which components are fixed on the surface's facets, by their cells (cells, dim)."""
    topology, dim = grid.mesh.topology, grid.dim
    if surface.grid is not grid:
        raise ValueError(f"surfaces: the facets {surface.names} belong to another grid")
    for pair in ((dim - 1, 0), (dim - 1, dim), (dim, 0)):
        topology.create_connectivity(*pair)
    vertices, corners = (topology.connectivity(d, 0) for d in (dim - 1, dim))
    node = np.zeros(
        topology.index_map(0).size_local + topology.index_map(0).num_ghosts, dtype=np.int32
    )
    node[corners.array] = dolfinx_versions.cell_dofs(
        grid.space
    ).ravel()  # the dofs of a cell come in its vertices' order
    there, seen = np.zeros((grid.cells, dim), dtype=bool), np.zeros(grid.cells, dtype=bool)
    for facet in surface.facets:
        held = fixed[node[vertices.links(facet)]].all(axis=0)
        cell = topology.connectivity(dim - 1, dim).links(facet)[0]
        if seen[cell] and (there[cell] != held).any():
            raise ValueError(
                f"surfaces: the facets {surface.names} meet in a corner, fixed in different ways; "
                "give them one by one"
            )
        there[cell], seen[cell] = held, True
    return there


def _refuse_free(there: Sequence[bool]) -> None:
    if not all(there):
        raise ValueError(f"surfaces: number {there.index(False)} is on no fixed edge of the grid")
