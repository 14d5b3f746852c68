"""The loops over points and cells: short, compiled by numba, no idea of their own.

``axes`` is the tuple of directions, (0, 1) or (0, 1, 2): its length is known when a kernel is compiled, so that
the loops over directions are unrolled (two to three times faster).
"""

from __future__ import annotations

import numba
import numpy as np

jit = numba.njit(cache=True, nogil=True)

EDGE = 1e-10  # of a cell: a point that far outside the grid still lies in its last cell


def digits(base: int, dim: int) -> np.ndarray:
    """Positions of a tensor-product table, first direction fastest (base^dim, dim)."""
    return np.stack(np.meshgrid(*[np.arange(base)] * dim, indexing="ij"), -1).reshape(-1, dim)[:, ::-1].copy()


@jit
def walk(x, cell, lower, upper, neighbour):
    """Move each entry of ``cell`` to the cell that holds x; -1 where that leaves the local grid.

    A point on an edge lies in the cell above it, at the end of the grid in the last one.
    ``neighbour`` (cells, dim, 2), -1 for none.
    """
    n, dim = x.shape
    for p in range(n):
        c = cell[p]
        d = 0
        while c >= 0 and d < dim:
            slack = EDGE * (upper[c, d] - lower[c, d])
            if x[p, d] < lower[c, d]:
                beyond = neighbour[c, d, 0]
                if beyond < 0 and x[p, d] >= lower[c, d] - slack:
                    d += 1
                else:
                    c = beyond
            elif x[p, d] >= upper[c, d]:
                beyond = neighbour[c, d, 1]
                if beyond < 0 and x[p, d] <= upper[c, d] + slack:
                    d += 1
                else:
                    c = beyond
            elif x[p, d] == x[p, d]:
                d += 1
            else:
                c = -1  # NaN
        cell[p] = c


@jit
def over_corner(cell, side, neighbour):
    """Whether one of the cells diagonally across ``side`` (dim,) of a cell is not there."""
    for corner in range(2 ** len(side)):
        c = cell
        for d in range(len(side)):
            if c >= 0 and side[d] != 0 and (corner >> d) & 1:
                c = neighbour[c, d, (side[d] + 1) // 2]
        if c < 0:
            return True
    return False


@jit
def spans(axes, x, half, cell, lower, upper, neighbour, side, span, share):
    """Cut each point's support domain at the edges of its cell, direction by direction.

    Segment 0 lies in the point's own cell, segment 1 in the neighbour on ``side`` (-1, 0 for none, 1).
    ``span`` (n, dim, 2, 2): ends in the cell's reference coordinate [0, 1]; ``share``: fraction of the domain.
    A half width of zero is the point itself.  Beyond the end of the grid the domain is cut off; where it reaches
    over an inward corner of the grid, it ends with its own cell.
    """
    n, dim = len(x), len(axes)
    for p in range(n):
        c = cell[p]
        crossed = 0
        for d in range(dim):
            low, high = lower[c, d], upper[c, d]
            h = high - low
            l = min(half[p, d], h / 2)
            a, b = x[p, d] - l, x[p, d] + l
            if l == 0.0:
                a = b = min(max(x[p, d], low), high)
            side[p, d] = 0
            beyond = -1
            if a < low and l > 0.0:
                beyond = neighbour[c, d, 0]
                side[p, d] = -1
            elif b > high and l > 0.0:
                beyond = neighbour[c, d, 1]
                side[p, d] = 1
            inner_a, inner_b = max(a, low), min(b, high)
            span[p, d, 0, 0] = (inner_a - low) / h
            span[p, d, 0, 1] = (inner_b - low) / h
            share[p, d, 0] = 1.0
            share[p, d, 1] = 0.0
            if side[p, d] != 0:
                if beyond < 0:
                    side[p, d] = 0
                else:
                    far = upper[beyond, d] - lower[beyond, d]
                    if side[p, d] < 0:
                        outer = min(low - a, far)
                        span[p, d, 1, 0], span[p, d, 1, 1] = 1.0 - outer / far, 1.0
                    else:
                        outer = min(b - high, far)
                        span[p, d, 1, 0], span[p, d, 1, 1] = 0.0, outer / far
                    total = outer + inner_b - inner_a
                    share[p, d, 0] = (inner_b - inner_a) / total
                    share[p, d, 1] = outer / total
                    crossed += 1
        if crossed > 1 and over_corner(c, side[p], neighbour):
            side[p] = 0
            share[p, :, 0], share[p, :, 1] = 1.0, 0.0


@jit
def nodal_weights(axes, side, span, share, cell, lower, upper, neighbour, patch, table, nodes, values, gradients):
    """Weights S_ip and gradients ∇S_ip: linear shape functions averaged over the support domain.

    ``table`` (k, dim): digits of the stencil, 0-1 for two nodes a direction, 0-2 for three;
    ``patch`` (cells, 4^dim): the nodes around each cell.  Outputs (n, k) and (n, k, dim).
    """
    n, dim = len(side), len(axes)
    line = np.empty((dim, 3))
    slope = np.empty((dim, 3))
    start = np.empty(dim, np.int64)
    for p in range(n):
        c = cell[p]
        for d in range(dim):
            h = upper[c, d] - lower[c, d]
            mid = 0.5 * (span[p, d, 0, 0] + span[p, d, 0, 1])
            s = share[p, d, 0]
            own_0, own_1, own_slope = s * (1 - mid), s * mid, s / h
            far_0 = far_1 = far_slope = 0.0
            if side[p, d] != 0:
                beyond = neighbour[c, d, (side[p, d] + 1) // 2]
                mid = 0.5 * (span[p, d, 1, 0] + span[p, d, 1, 1])
                s = share[p, d, 1]
                far_0, far_1 = s * (1 - mid), s * mid
                far_slope = s / (upper[beyond, d] - lower[beyond, d])
            if side[p, d] < 0:
                start[d] = 0
                line[d, 0], line[d, 1], line[d, 2] = far_0, far_1 + own_0, own_1
                slope[d, 0], slope[d, 1], slope[d, 2] = -far_slope, far_slope - own_slope, own_slope
            else:
                start[d] = 1
                line[d, 0], line[d, 1], line[d, 2] = own_0, own_1 + far_0, far_1
                slope[d, 0], slope[d, 1], slope[d, 2] = -own_slope, own_slope - far_slope, far_slope
        for m in range(len(table)):
            place = 0
            w = 1.0
            for d in range(dim - 1, -1, -1):
                place = 4 * place + start[d] + table[m, d]
                w *= line[d, table[m, d]]
            nodes[p, m] = max(patch[c, place], 0)  # a node that is not there has no weight
            values[p, m] = w
            for d in range(dim):
                g = slope[d, table[m, d]]
                for e in range(dim):
                    if e != d:
                        g *= line[e, table[m, e]]
                gradients[p, m, d] = g


@jit
def scatter(nodes, weights, values, out):
    """out_i += Σ_p w_ip q_p for values (n, f)."""
    for p in range(len(nodes)):
        for m in range(nodes.shape[1]):
            for f in range(values.shape[1]):
                out[nodes[p, m], f] += weights[p, m] * values[p, f]


@jit
def scatter_divergence(axes, nodes, gradients, stress, out):
    """out_i += Σ_p σ_p ∇S_ip for volume-weighted stress tensors (n, dim, dim)."""
    dim = len(axes)
    for p in range(len(nodes)):
        for m in range(nodes.shape[1]):
            for i in range(dim):
                t = 0.0
                for j in range(dim):
                    t += stress[p, i, j] * gradients[p, m, j]
                out[nodes[p, m], i] += t


@jit
def interpolate(nodes, weights, field, out):
    """out_p = Σ_i w_ip q_i for nodal values (nodes, f)."""
    for p in range(len(nodes)):
        for f in range(field.shape[1]):
            s = 0.0
            for m in range(nodes.shape[1]):
                s += weights[p, m] * field[nodes[p, m], f]
            out[p, f] = s


@jit
def interpolate_gradient(axes, nodes, gradients, field, out):
    """out_p,ij = Σ_i q_i ∂_j S_ip for nodal vectors (nodes, dim)."""
    dim = len(axes)
    for p in range(len(nodes)):
        for i in range(dim):
            for j in range(dim):
                s = 0.0
                for m in range(nodes.shape[1]):
                    s += field[nodes[p, m], i] * gradients[p, m, j]
                out[p, i, j] = s


@jit
def project(axes, side, span, share, cell, volume, neighbour, dual, corners, table, dofs, values, out):
    """Cell by cell, add each point's values to the dofs of a discontinuous field.

    out_ck += q_p / |c| ∏_d Σ_j dual_kj ⟨ξ^j⟩, the mean of ξ^j taken over the segment of the support domain in c.
    ``values`` (n, f) are volume-weighted; ``corners`` (2^dim, dim) and ``table`` (k^dim, dim) digit tables;
    ``out`` (dofs, f).
    """
    n, dim = len(side), len(axes)
    k = len(dual)
    line = np.empty((dim, 2, k))
    for p in range(n):
        crossed = 0
        for d in range(dim):
            for s in range(2 if side[p, d] != 0 else 1):
                a, b = span[p, d, s, 0], span[p, d, s, 1]
                for j in range(k):
                    w = dual[j, 0] + dual[j, 1] * 0.5 * (a + b)
                    if k == 3:
                        w += dual[j, 2] * (a * a + a * b + b * b) / 3.0
                    line[d, s, j] = share[p, d, s] * w
            crossed += side[p, d] != 0
        for q in range(len(corners) if crossed else 1):
            c = cell[p]
            for d in range(dim):
                if corners[q, d]:
                    c = neighbour[c, d, (side[p, d] + 1) // 2] if side[p, d] != 0 and c >= 0 else -1
            if c < 0:
                continue
            for m in range(len(table)):
                w = 1.0 / volume[c]
                for d in range(dim):
                    w *= line[d, corners[q, d], table[m, d]]
                for f in range(values.shape[1]):
                    out[dofs[c, m], f] += w * values[p, f]
