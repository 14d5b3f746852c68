"""The loops over points and cells: short, compiled by numba, no idea of their own.

``axes`` is the tuple of directions, (0, 1) or (0, 1, 2), and ``line`` holds weights direction by
direction, of which tensor products are taken.  Lengths of tuples are known when a kernel is
compiled, so that loops over them are unrolled (``once`` makes one of the length of a table), and
indices without sign need no test for the end they count from: together two to four times faster.
"""

from __future__ import annotations

import numpy as np

from ..common.compiled import jit
from ..grid.cells import over_corner


@jit
def place(axes, points, cells, cut, weights):
    """Cut each point's support domain at the edges of its cell, direction by direction, and weigh
    the nodes.

    ``points`` (x, half support domains, cell); ``cells`` (lower, upper, neighbour) of ``Lattice``;
    written are ``cut`` (side, span, share) and ``weights`` (first, line, slope).

    Segment 0 lies in the point's own cell, segment 1 in the neighbour on ``side`` (-1, 0 for none,
    1). ``span`` (n, dim, 2, 2): ends in the cell's reference coordinate [0, 1]; ``share``: fraction
    of the domain. A half width of zero is the point itself.  Beyond the end of the grid the domain
    is cut off; where it reaches over an inward corner of the grid, it ends with its own cell.

    ``line`` (n, dim, k), ``slope`` (1/m): linear shape functions averaged over the domain along
    each direction, and their derivatives, for k = 2 or 3 nodes from ``first`` on, an entry of
    ``Lattice.around``.
    """
    x, half, cell = points
    lower, upper, neighbour = cells
    side, span, share = cut
    first, line, slope = weights
    n, dim = len(x), len(axes)
    for p in range(n):
        c = cell[p]
        crossed = 0
        for d in range(dim):
            l = min(half[p, d], 0.5 * (upper[c, d] - lower[c, d]))
            s = 0
            if l > 0.0:
                if x[p, d] - l < lower[c, d]:
                    s = -1 if neighbour[c, d, 0] >= 0 else 0
                elif x[p, d] + l > upper[c, d]:
                    s = 1 if neighbour[c, d, 1] >= 0 else 0
            side[p, d] = s
            crossed += s != 0
        if crossed > 1 and over_corner(c, side[p], neighbour):
            side[p] = 0
        start, stride = 0, 1
        for d in range(dim):
            low, high, s = lower[c, d], upper[c, d], side[p, d]
            per_h = 1.0 / (high - low)
            l = min(half[p, d], 0.5 * (high - low))
            a, b = max(x[p, d] - l, low), min(x[p, d] + l, high)
            if l == 0.0:
                a = b = min(max(x[p, d], low), high)
            span[p, d, 0, 0], span[p, d, 0, 1] = (a - low) * per_h, (b - low) * per_h
            mid = 0.5 * (span[p, d, 0, 0] + span[p, d, 0, 1])
            if s == 0:
                share[p, d, 0], share[p, d, 1] = 1.0, 0.0
                line[p, d, 0], line[p, d, 1] = 1.0 - mid, mid
                slope[p, d, 0], slope[p, d, 1] = -per_h, per_h
                if line.shape[2] == 3:
                    line[p, d, 2] = slope[p, d, 2] = 0.0
            else:
                beyond = neighbour[c, d, (s + 1) // 2]
                far = upper[beyond, d] - lower[beyond, d]
                outer, inner = min(low - x[p, d] + l if s < 0 else x[p, d] + l - high, far), b - a
                reach = outer / far
                span[p, d, 1, 0], span[p, d, 1, 1] = (1.0 - reach, 1.0) if s < 0 else (0.0, reach)
                own, there = inner / (inner + outer), outer / (inner + outer)
                share[p, d, 0], share[p, d, 1] = own, there
                far_mid = 0.5 * (span[p, d, 1, 0] + span[p, d, 1, 1])
                g, far_g = own * per_h, there / far
                if s < 0:
                    line[p, d, 0] = there * (1.0 - far_mid)
                    line[p, d, 1] = there * far_mid + own * (1.0 - mid)
                    line[p, d, 2] = own * mid
                    slope[p, d, 0], slope[p, d, 1], slope[p, d, 2] = -far_g, far_g - g, g
                else:
                    line[p, d, 0] = own * (1.0 - mid)
                    line[p, d, 1] = own * mid + there * (1.0 - far_mid)
                    line[p, d, 2] = there * far_mid
                    slope[p, d, 0], slope[p, d, 1], slope[p, d, 2] = -g, g - far_g, far_g
            start += stride if s >= 0 else 0
            stride *= 4
        first[p] = c * stride + start


@jit
def scatter(axes, reach, columns, weights, values, out):
    """out_i += Σ_p w_ip q_p for values (n, columns); ``weights`` (around, first, line)."""
    around, first, line = weights
    dim, n = len(axes), len(reach)
    for p in range(len(first)):
        for k in range(n if dim == 3 else 1):
            for j in range(n):
                across = line[p, 1, j] * (line[p, 2, k] if dim == 3 else 1.0)
                for i in range(n):
                    w = across * line[p, 0, i]
                    node = around[first[p] + np.uint64(i + 4 * j + 16 * k)]
                    for f in range(len(columns)):
                        out[node, f] += w * values[p, f]


@jit
def scatter_motion(axes, reach, weights, points, out):
    """out_i += Σ_p w_ip m_p (1, v_p, a_p); ``points`` (m, v, a)."""
    around, first, line = weights
    mass, velocity, acceleration = points
    dim, n = len(axes), len(reach)
    for p in range(len(first)):
        for k in range(n if dim == 3 else 1):
            for j in range(n):
                across = mass[p] * line[p, 1, j] * (line[p, 2, k] if dim == 3 else 1.0)
                for i in range(n):
                    w = across * line[p, 0, i]
                    node = around[first[p] + np.uint64(i + 4 * j + 16 * k)]
                    out[node, 0] += w
                    for d in range(dim):
                        out[node, 1 + d] += w * velocity[p, d]
                        out[node, 1 + dim + d] += w * acceleration[p, d]


@jit
def scatter_divergence(axes, reach, weights, slope, stress, out):
    """out_i += Σ_p σ_p ∇w_ip for volume-weighted stress tensors (n, dim, dim)."""
    around, first, line = weights
    dim, n = len(axes), len(reach)
    for p in range(len(first)):
        for k in range(n if dim == 3 else 1):
            wz = line[p, 2, k] if dim == 3 else 1.0
            for j in range(n):
                flat, y = line[p, 1, j] * wz, slope[p, 1, j] * wz
                for i in range(n):
                    node = around[first[p] + np.uint64(i + 4 * j + 16 * k)]
                    gx, gy = slope[p, 0, i] * flat, line[p, 0, i] * y
                    gz = line[p, 0, i] * line[p, 1, j] * slope[p, 2, k] if dim == 3 else 0.0
                    for d in range(dim):
                        t = stress[p, d, 0] * gx + stress[p, d, 1] * gy
                        if dim == 3:
                            t += stress[p, d, 2] * gz
                        out[node, d] += t


@jit
def scatter_stress(axes, reach, weights, slope, points, out):
    """out_i += Σ_p V_p σ_p ∇w_ip; ``points`` (V, stress rows σ (n, components))."""
    around, first, line = weights
    volume, stress = points
    dim, n = len(axes), len(reach)
    for p in range(len(first)):
        V = volume[p]
        xx, yy, xy = V * stress[p, 0], V * stress[p, 1], V * stress[p, 3]
        zz, yz, xz = 0.0, 0.0, 0.0
        if dim == 3:
            zz, yz, xz = V * stress[p, 2], V * stress[p, 4], V * stress[p, 5]
        for k in range(n if dim == 3 else 1):
            wz = line[p, 2, k] if dim == 3 else 1.0
            for j in range(n):
                flat, y = line[p, 1, j] * wz, slope[p, 1, j] * wz
                z = line[p, 1, j] * slope[p, 2, k] if dim == 3 else 0.0
                for i in range(n):
                    node = around[first[p] + np.uint64(i + 4 * j + 16 * k)]
                    gx, gy = slope[p, 0, i] * flat, line[p, 0, i] * y
                    if dim == 3:
                        gz = line[p, 0, i] * z
                        out[node, 0] += xx * gx + xy * gy + xz * gz
                        out[node, 1] += xy * gx + yy * gy + yz * gz
                        out[node, 2] += xz * gx + yz * gy + zz * gz
                    else:
                        out[node, 0] += xx * gx + xy * gy
                        out[node, 1] += xy * gx + yy * gy


@jit
def interpolate(axes, reach, columns, weights, field, out):
    """out_p = Σ_i w_ip q_i for nodal values (nodes, columns)."""
    around, first, line = weights
    dim, n = len(axes), len(reach)
    for p in range(len(first)):
        for f in range(len(columns)):
            total = 0.0
            for k in range(n if dim == 3 else 1):
                for j in range(n):
                    across = line[p, 1, j] * (line[p, 2, k] if dim == 3 else 1.0)
                    for i in range(n):
                        node = around[first[p] + np.uint64(i + 4 * j + 16 * k)]
                        total += across * line[p, 0, i] * field[node, f]
            out[p, f] = total


@jit
def interpolate_gradient(axes, reach, weights, slope, field, out):
    """out_p,ij = Σ_i q_i ∂_j w_ip for nodal vectors (nodes, dim)."""
    around, first, line = weights
    dim, n = len(axes), len(reach)
    for p in range(len(first)):
        for e in range(dim):
            gx = gy = gz = 0.0
            for k in range(n if dim == 3 else 1):
                x = y = flat = 0.0
                for j in range(n):
                    value = along = 0.0
                    for i in range(n):
                        q = field[around[first[p] + np.uint64(i + 4 * j + 16 * k)], e]
                        value += line[p, 0, i] * q
                        along += slope[p, 0, i] * q
                    x += line[p, 1, j] * along
                    y += slope[p, 1, j] * value
                    flat += line[p, 1, j] * value
                gx += x * (line[p, 2, k] if dim == 3 else 1.0)
                gy += y * (line[p, 2, k] if dim == 3 else 1.0)
                gz += flat * slope[p, 2, k] if dim == 3 else 0.0
            out[p, e, 0], out[p, e, 1] = gx, gy
            if dim == 3:
                out[p, e, 2] = gz


@jit
def interpolate_stretch(axes, reach, weights, slope, field, out):
    """out_p,d = 1 + Σ_i u_id ∂_d w_ip for nodal displacements u (nodes, dim): how much longer
    support domains are along each direction."""
    around, first, line = weights
    dim, n = len(axes), len(reach)
    for p in range(len(first)):
        for d in range(dim):
            total = 1.0
            for k in range(n if dim == 3 else 1):
                z = 1.0
                if dim == 3:
                    z = slope[p, 2, k] if d == 2 else line[p, 2, k]
                for j in range(n):
                    yz = z * (slope[p, 1, j] if d == 1 else line[p, 1, j])
                    for i in range(n):
                        node = around[first[p] + np.uint64(i + 4 * j + 16 * k)]
                        total += yz * (slope[p, 0, i] if d == 0 else line[p, 0, i]) * field[node, d]
            out[p, d] = total


@jit
def advance(axes, reach, weights, nodal, points, rule, shapes):
    """Points move by u(x_p), take v += Δt ((1 - γ) a + γ a₁(x_p)), a = a₁(x_p), and grow.

    ``nodal`` (nodes, 2 dim): u (m) and a₁ (m/s²); ``points`` (x, v, a); ``rule``: Δt (1 - γ) and
    Δt γ; ``shapes`` (V, half support domains, J, stretch), of which V *= J and half *= stretch.
    """
    around, first, line = weights
    x, v, a = points
    before, after = rule
    volume, half, J, stretch = shapes
    dim, n = len(axes), len(reach)
    for p in range(len(first)):
        for d in range(dim):
            u = a1 = 0.0
            for k in range(n if dim == 3 else 1):
                for j in range(n):
                    across = line[p, 1, j] * (line[p, 2, k] if dim == 3 else 1.0)
                    for i in range(n):
                        w = across * line[p, 0, i]
                        node = around[first[p] + np.uint64(i + 4 * j + 16 * k)]
                        u += w * nodal[node, d]
                        a1 += w * nodal[node, dim + d]
            v[p, d] += before * a[p, d] + after * a1
            a[p, d] = a1
            x[p, d] += u
            half[p, d] *= stretch[p, d]
        volume[p] *= J[p]
