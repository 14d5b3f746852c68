"""The internal force of the stress that material points bear."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from dolfinx import fem

from ..common import tensors
from ..common.compiled import jit, once
from ..grid import dolfinx_versions
from ..grid.grid import Grid
from ..points.material_points import MaterialPoints
from .shape_functions import Stencil

SPREAD = 0.05
"""Least determinant of the places' gradient, 1 where points fill the cells around: below, stress is
constant."""


class InternalForce(Protocol):
    """Where the internal force of points is taken from."""

    def add(
        self,
        bodies: Sequence[MaterialPoints],
        stencils: Sequence[Stencil],
        internal: np.ndarray,
        stresses: Sequence[np.ndarray] | None = None,
    ) -> None:
        """Add the force of all bodies to ``internal`` (nodes, dim), N: of their own stress, or of
        ``stresses``, Pa: rows (n, components), or tensors (n, dim, dim) that need not be
        symmetric."""


class ConstantStress:
    """Stress is constant over each support domain: Σ_p V_p σ_p ∇S_ip."""

    def __init__(self, grid: Grid):
        self.grid = grid

    def add(
        self,
        bodies: Sequence[MaterialPoints],
        stencils: Sequence[Stencil],
        internal: np.ndarray,
        stresses: Sequence[np.ndarray] | None = None,
    ) -> None:
        """Add the force of all bodies to ``internal`` (nodes, dim), N: of their own stress, or of
        ``stresses``, as ``InternalForce`` takes them."""
        given = [body.stress for body in bodies] if stresses is None else stresses
        for body, stencil, stress in zip(bodies, stencils, given, strict=True):
            if stress.ndim == 2:
                stencil.deposit_stress(body.volume, stress, internal)
            else:
                stencil.deposit_divergence(body.volume[:, None, None] * stress, internal)


class LinearStress:
    """Stress is linear over each support domain, and each part that grid lines cut off pulls with
    that at its centre.

    Where it is taken as constant, the parts pull with the stress of the whole: dipoles that move
    with the points and do not cancel where domains differ or the body ends, which leaves stress off
    by O(h) (studies/manufactured_causes.py). Adds up Σ_p Σ_k V_k (σ_p + G_p (x_k − x_p)) ∇N_i(x_k)
    over the parts k of cut support domains, x_k their centres.

    G_p is exact where stress is linear in space, whatever the points: nodes carry the means σ̄_i
    and x̄_i of stress and place around, and G Σ x̄_i ⊗ ∇S_i = Σ σ̄_i ⊗ ∇S_i.  Each body has nodal
    means of its own.
    """

    def __init__(self, grid: Grid):
        self.grid = grid
        shear = tensors.SHEAR[grid.dim]
        self._columns = np.array([*range(grid.dim), *range(3, 3 + len(shear))])
        self._at = np.zeros((grid.dim, grid.dim), np.int64)  # which of them is σ_ij
        for i in range(grid.dim):
            self._at[i, i] = i
        for k, (i, j) in enumerate(shear):
            self._at[i, j] = self._at[j, i] = grid.dim + k
        numbers = 1 + len(self._columns) + grid.dim
        self._shared = (
            None
            if grid.comm.size == 1
            else fem.Function(dolfinx_versions.space(grid.mesh, "Lagrange", 1, (numbers,)))
        )
        self._mean = (
            np.zeros((grid.nodes, numbers))
            if self._shared is None
            else self._shared.x.array.reshape(grid.nodes, numbers)
        )

    def add(
        self,
        bodies: Sequence[MaterialPoints],
        stencils: Sequence[Stencil],
        internal: np.ndarray,
        stresses: Sequence[np.ndarray] | None = None,
    ) -> None:
        """Add the force of all bodies to ``internal`` (nodes, dim), N: of their own stress, or of
        ``stresses``, what of these is skew as a constant over each domain."""
        given = [body.stress for body in bodies] if stresses is None else stresses
        for body, stencil, stress in zip(bodies, stencils, given, strict=True):
            if stress.ndim == 2:
                rows = np.ascontiguousarray(stress[:, self._columns])
            else:
                rows, skew = tensors.symmetric_row(stress)
                if skew.any():
                    stencil.deposit_divergence(body.volume[:, None, None] * skew, internal)
            self._add(body, stencil, rows, internal)

    def _add(
        self, body: MaterialPoints, at: Stencil, stress: np.ndarray, internal: np.ndarray
    ) -> None:
        """Add the force of stress rows (n, columns), Pa."""
        grid, lat = self.grid, at.lattice
        self._mean[:] = 0.0
        columns, points = once(stress.shape[1]), (body.volume, stress, body.x)
        _sum(grid.axes, at.reach, columns, at.weights, points, self._mean)
        if self._shared is not None:
            dolfinx_versions.gather(self._shared)  # a node's points lie on several ranks
        _divide(self._mean)
        _pull(
            (grid.axes, at.reach, columns, self._at),
            (at.cell, *at.cut),
            (*lat.bounds, lat.nodes),
            (*at.weights, at.slope),
            points,
            self._mean,
            internal,
        )


@jit
def _sum(axes, reach, columns, weights, points, out):
    """out_i += Σ_p S_ip V_p (1, σ_p, x_p); ``points`` (V, σ, x)."""
    around, first, line = weights
    volume, stress, x = points
    dim, n, m = len(axes), len(reach), len(columns)
    for p in range(len(first)):
        for k in range(n if dim == 3 else 1):
            for j in range(n):
                across = volume[p] * line[p, 1, j] * (line[p, 2, k] if dim == 3 else 1.0)
                for i in range(n):
                    w = across * line[p, 0, i]
                    node = around[first[p] + np.uint64(i + 4 * j + 16 * k)]
                    out[node, 0] += w
                    for f in range(m):
                        out[node, 1 + f] += w * stress[p, f]
                    for d in range(dim):
                        out[node, 1 + m + d] += w * x[p, d]


@jit
def _divide(nodal):
    """Divide nodal sums (nodes, f) by the first of them, which stays; nothing where that is
    zero."""
    for i in range(len(nodal)):
        if nodal[i, 0] > 0.0:
            share = 1.0 / nodal[i, 0]
            for f in range(1, nodal.shape[1]):
                nodal[i, f] *= share


@jit
def _invert(a, out):
    """Inverse of a (dim, dim) matrix times its determinant; returns that."""
    if len(a) == 2:
        out[0, 0], out[0, 1], out[1, 0], out[1, 1] = a[1, 1], -a[0, 1], -a[1, 0], a[0, 0]
        return a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    for i in range(3):
        for j in range(3):
            k, m, r, s = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            out[i, j] = a[k, r] * a[m, s] - a[k, s] * a[m, r]
    return a[0, 0] * out[0, 0] + a[0, 1] * out[1, 0] + a[0, 2] * out[2, 0]


@jit
def _pull(layout, cut, cells, weights, points, mean, out):
    """The sum of ``LinearStress``; ``mean`` (nodes, 1 + components + dim) of ``_sum``.

    ``layout`` (axes, reach, columns, at), ``at`` (dim, dim) the columns of σ_ij; ``cut`` (cell,
    side, span, share); ``cells`` (lower, upper, neighbour, nodes); ``weights`` (around, first,
    line, slope); ``points`` (V, σ, x).
    """
    axes, reach, columns, at = layout
    cell, side, span, share = cut
    lower, upper, neighbour, nodes = cells
    around, first, line, slope = weights
    volume, stress, x = points
    dim, n, m = len(axes), len(reach), len(columns)
    found, inverse = np.empty((m + dim, dim)), np.empty((dim, dim))
    gradient, σ = np.zeros((m, dim)), np.empty(m)
    place, per_h, away, g = np.empty(dim), np.empty(dim), np.empty(dim), np.empty(dim)
    for p in range(len(first)):
        cuts = 0
        for d in range(dim):
            cuts += side[p, d] != 0
        if cuts:
            found[:] = 0.0
            for k in range(n if dim == 3 else 1):
                wz = line[p, 2, k] if dim == 3 else 1.0
                for j in range(n):
                    flat, y = line[p, 1, j] * wz, slope[p, 1, j] * wz
                    for i in range(n):
                        node = around[first[p] + np.uint64(i + 4 * j + 16 * k)]
                        g[0], g[1] = slope[p, 0, i] * flat, line[p, 0, i] * y
                        if dim == 3:
                            g[2] = line[p, 0, i] * line[p, 1, j] * slope[p, 2, k]
                        for f in range(m + dim):
                            q = mean[node, 1 + f]
                            for d in range(dim):
                                found[f, d] += q * g[d]
            determinant = _invert(found[m:], inverse)
            per = 1.0 / determinant if determinant > SPREAD else 0.0
            for f in range(m):
                for d in range(dim):
                    total = 0.0
                    for e in range(dim):
                        total += found[f, e] * inverse[e, d]
                    gradient[f, d] = total * per
        for part in range(2**dim if cuts else 1):
            c, weight = cell[p], volume[p]
            for d in range(dim):
                s = (part >> d) & 1
                weight *= share[p, d, s]
                if s == 1 and weight > 0.0:
                    c = neighbour[c, d, (side[p, d] + 1) // 2]
            if weight == 0.0:
                continue
            for d in range(dim):
                s = (part >> d) & 1
                h = upper[c, d] - lower[c, d]
                place[d], per_h[d] = 0.5 * (span[p, d, s, 0] + span[p, d, s, 1]), 1.0 / h
                away[d] = lower[c, d] + place[d] * h - x[p, d]
            for f in range(m):
                σ[f] = stress[p, f]
                if cuts:
                    for d in range(dim):
                        σ[f] += gradient[f, d] * away[d]
            for corner in range(2**dim):
                for d in range(dim):
                    g[d] = weight
                    for e in range(dim):
                        upward = (corner >> e) & 1
                        if d == e:
                            g[d] *= per_h[d] if upward else -per_h[d]
                        else:
                            g[d] *= place[e] if upward else 1.0 - place[e]
                for e in range(dim):
                    total = 0.0
                    for d in range(dim):
                        total += σ[at[e, d]] * g[d]
                    out[nodes[c, corner], e] += total
