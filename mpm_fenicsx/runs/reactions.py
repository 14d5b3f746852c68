"""Reactions of fixed edges as tractions, for surfaces that are to bear them when the fixities are
gone.

The system is one of the nodes on surfaces alone, and small: on several ranks each sends its rows to
the first, which solves and hands the tractions to all.
"""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from scipy.sparse import csr_matrix, vstack
from scipy.sparse.linalg import lsqr, spsolve

from ..common.ranks import together
from ..grid import dolfinx_versions
from ..grid.grid import Grid, GridSurface
from ..mapping.ties import Ties, summed
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
    Of surface points the value has a row for each, on several ranks one for each of all ranks,
    ``SurfacePoints.of_given`` of which are those here.  Collective.
    Raises ``ValueError``, on all ranks, for surfaces of both kinds or none, one that is on no fixed
    edge, or too few surface points.
    """
    R = fem.Function(scene.grid.space)
    R.x.array[:] = borne
    dolfinx_versions.share(R)  # ghosts may have other values
    fixed, borne = (a.reshape(-1, scene.grid.dim) for a in (fixed, R.x.array))
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
    grid, comm = scene.grid, scene.grid.comm
    weights = [_weights(surface, scene) for surface in surfaces]  # (points, nodes) each
    there = [abs(w) @ (~fixed).astype(float) <= HAIR for w in weights]  # (points, dim) each
    _refuse_free(comm, there)
    lengths = [len(s) if s.number is None else s.given for s in surfaces]  # of all ranks
    ends = np.cumsum([0, *lengths])
    number = np.concatenate(
        [
            start + (np.arange(len(s)) if s.number is None else s.number)
            for start, s in zip(ends[:-1], surfaces, strict=True)
        ]
    )
    weights, there = vstack(weights, format="csr"), np.concatenate(there)
    largest = comm.allreduce(float(np.abs(borne).max(initial=0.0)), op=MPI.MAX)
    root = np.sqrt(np.concatenate([surface.area for surface in surfaces]))
    t = np.zeros((ends[-1], grid.dim))
    for c in range(grid.dim):
        rows = np.flatnonzero(there[:, c])
        if not comm.allreduce(len(rows)):
            continue
        mine = weights[rows]
        reached, R = summed(grid, np.asarray(mine.sum(axis=0)).ravel()) > HAIR, borne[:, c]
        if ties is not None:
            R = ties.hand_over(R, fixed[:, c] & ~reached, fixed[:, c] & reached)
        entries = mine.tocoo()
        at, value = rows[entries.row], entries.data
        nodes = grid.space.dofmap.index_map
        column = nodes.local_to_global(entries.col.astype(np.int32))
        touched = np.flatnonzero(reached[: nodes.size_local]).astype(np.int32)
        system = _gathered(comm, number[rows], root[rows], number[at], column, value * root[at])
        known = _gathered(comm, nodes.local_to_global(touched), R[touched])
        with together(comm):
            if comm.rank == 0:
                points, found = _least(*system, *known, largest)
                t[points, c] = found
    return np.split(comm.bcast(t), ends[1:-1])


def _weights(surface: SurfacePoints, scene: Scene) -> csr_matrix:
    """What a load of 1 on each point of a surface gives to the nodes (points, nodes)."""
    patch = next((p for p in scene.patches if p.surface is surface), None)
    if patch is None:
        patch = PointPatch(surface, scene)
    patch.locate()
    return patch.faces.weights


def _least(
    points: np.ndarray,
    root: np.ndarray,
    number: np.ndarray,
    column: np.ndarray,
    value: np.ndarray,
    nodes: np.ndarray,
    R: np.ndarray,
    largest: float,
) -> tuple[np.ndarray, np.ndarray]:
    """The numbers of points, and of all t with Σ_m A_m N_i(x_m) t_m = R_i the one with the least
    Σ_m A_m t_m².

    ``root`` (points,) is √A; ``value`` = √A N (entries,) of the points ``number`` at nodes
    ``column``; ``nodes``, ``R``: those that the points touch.  Raises ``ValueError`` where that
    misses more than a part of ``largest``.
    """
    order, there = np.argsort(points), np.isin(column, nodes)
    points, root = points[order], root[order]
    at = np.searchsorted(nodes, column[there]), np.searchsorted(points, number[there])
    A = csr_matrix((value[there], at), shape=(len(nodes), len(points)))
    scale = 1.0 / np.sqrt(np.asarray(A.multiply(A).sum(axis=1)).ravel())
    B = csr_matrix(A.multiply(scale[:, None]))
    y = lsqr(B, scale * R, atol=1e-15, btol=1e-15, conlim=0.0, iter_lim=50 * len(points))[0]
    miss = np.abs(A @ y - R).max() / max(largest, np.finfo(float).tiny)
    if not miss <= EXACT:
        raise ValueError(
            f"surfaces: their points are too few for the reactions, {miss:.1e} of which they miss"
        )
    return points, y / root


def _on_facets(
    scene: Scene, fixed: np.ndarray, borne: np.ndarray, surfaces: Sequence, ties: Ties | None
) -> list[fem.Function]:
    grid, comm, mesh, dim = scene.grid, scene.grid.comm, scene.grid.mesh, scene.grid.dim
    marks = dolfinx_versions.space(mesh, "DQ", 0, (dim,))
    at = dolfinx_versions.cell_dofs(marks)[:, 0]
    there = [_marks(grid, surface, fixed) for surface in surfaces]  # (cells, dim) each
    _refuse_free(comm, there)
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
    row, first = np.repeat(np.arange(len(start) - 1), np.diff(start)), A.getOwnershipRange()[0]
    held = A.getDiagonal().array > 0.0
    touched, own = np.flatnonzero(held), held[row]
    system = _gathered(comm, first + row[own], column[own], value[own])
    counts, known = (
        comm.gather(len(touched)),
        _gathered(comm, first + touched, borne.ravel()[touched]),
    )
    parts = None
    if comm.rank == 0:
        parts = np.split(_density(*system, *known), np.cumsum(counts)[:-1])
    λ = fem.Function(grid.space)
    λ.x.array[touched] = comm.scatter(parts)
    dolfinx_versions.share(λ)
    V, found = dolfinx_versions.space(mesh, "DQ", 1, (dim,)), []
    for part in there:
        t = fem.Function(V, name="reaction")
        t.interpolate(λ)
        t.x.array.reshape(-1, dim)[dolfinx_versions.cell_dofs(V)] *= part[:, None]
        found.append(t)
    return found


def _density(
    row: np.ndarray, column: np.ndarray, value: np.ndarray, touched: np.ndarray, R: np.ndarray
) -> np.ndarray:
    """λ of ∫ N_i λ ds = R_i at the dofs ``touched``, with entries of that mass matrix."""
    there = np.isin(column, touched)
    at = (np.searchsorted(touched, dofs[there]) for dofs in (row, column))
    M = csr_matrix((value[there], tuple(at)), shape=(len(touched), len(touched)))
    return spsolve(M.tocsc(), R)


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
    with together(grid.comm):
        for facet in surface.facets:
            held = fixed[node[vertices.links(facet)]].all(axis=0)
            cell = topology.connectivity(dim - 1, dim).links(facet)[0]
            if seen[cell] and (there[cell] != held).any():
                raise ValueError(
                    f"surfaces: the facets {surface.names} meet in a corner, fixed in different "
                    "ways; give them one by one"
                )
            there[cell], seen[cell] = held, True
    return there


def _refuse_free(comm: MPI.Comm, there: Sequence[np.ndarray]) -> None:
    """Raise ``ValueError`` where a surface has nothing (things, dim) that is fixed, on any rank."""
    held = comm.allreduce(np.array([part.any() for part in there], dtype=int)) > 0
    if not held.all():
        raise ValueError(f"surfaces: number {np.argmin(held)} is on no fixed edge of the grid")


def _gathered(comm: MPI.Comm, *arrays: np.ndarray) -> list[np.ndarray]:
    """Arrays of all ranks one after the other, on the first; empty elsewhere."""
    found = comm.gather(arrays)
    return [np.concatenate(parts) for parts in zip(*found, strict=True)] if found else []
