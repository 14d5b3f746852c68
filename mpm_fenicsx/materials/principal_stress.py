"""Principal stresses, and what goes back from them to rows: stress and its derivative.

With the spectral decomposition x = Σ_a x_a P_a, P_a = v_a ⊗ v_a, of a trial stress and a law
s(x_1, x_2, x_3) between principal values, isotropic and at unchanged directions, the tangent is

    Σ_ab D_ab P_a ⊗ P_b + Σ_{a<b} 4 g_ab S_ab ⊗ S_ab,   g_ab = μ (s_a - s_b)/(x_a - x_b)

with D_ab = ∂s_a/∂ε_b and S_ab the symmetric part of v_a ⊗ v_b; where x_a = x_b, g_ab is the limit
(D_aa - D_ab - D_ba + D_bb)/4 (de Souza Neto, Perić and Owen, Computational Methods for Plasticity,
2008, appendix A).  In plane strain the decomposition is a closed form in the double angle.
"""

from __future__ import annotations

import math

import numpy as np

from ..common.compiled import jit

EQUAL = 1e-11
"""Principal stresses closer than this part of the largest are equal."""


@jit
def spectrum():
    """Room for the decomposition of one row: values (3,), projections P (3, 6) and S (3, 6) of the
    pairs (0, 1), (0, 2), (1, 2), and eigenvectors (3, 3) and matrix (3, 3) to work with."""
    return np.empty(3), np.zeros((3, 6)), np.zeros((3, 6)), np.empty((3, 3)), np.empty((3, 3))


@jit
def decompose(row, room):
    """Write the principal values of a stress row, the largest first, and their projections."""
    if len(row) == 4:
        _decompose_plane(row, room)
    else:
        _decompose_space(row, room)


@jit
def largest_and_smallest(row, room):
    """Return the largest and the smallest principal stress of a row."""
    if len(row) == 4:
        mean, half = 0.5 * (row[0] + row[1]), 0.5 * (row[0] - row[1])
        radius = math.sqrt(half * half + row[3] * row[3])
        return max(mean + radius, row[2]), min(mean - radius, row[2])
    values, vectors, matrix = room[0], room[3], room[4]
    _fill(row, matrix)
    _jacobi(matrix, values, vectors)
    return max(values[0], values[1], values[2]), min(values[0], values[1], values[2])


@jit
def _decompose_plane(row, room):
    values, P, S = room[0], room[1], room[2]
    mean, half, shear = 0.5 * (row[0] + row[1]), 0.5 * (row[0] - row[1]), row[3]
    radius = math.sqrt(half * half + shear * shear)
    cosine, sine = (half / radius, shear / radius) if radius > 0.0 else (1.0, 0.0)
    high, low = mean + radius, mean - radius
    first = 1 if row[2] > high else 0
    last = 2 if row[2] > low else 1
    across = 3 - first - last
    values[first], values[last], values[across] = high, low, row[2]
    P[:, :4] = 0.0
    S[:, :4] = 0.0
    P[first, 0], P[first, 1], P[first, 3] = 0.5 + 0.5 * cosine, 0.5 - 0.5 * cosine, 0.5 * sine
    P[last, 0], P[last, 1], P[last, 3] = 0.5 - 0.5 * cosine, 0.5 + 0.5 * cosine, -0.5 * sine
    P[across, 2] = 1.0
    pair = first + last - 1
    S[pair, 0], S[pair, 1], S[pair, 3] = -0.5 * sine, 0.5 * sine, 0.5 * cosine


@jit
def _fill(row, matrix):
    for i in range(3):
        matrix[i, i] = row[i]
    matrix[0, 1] = matrix[1, 0] = row[3]
    matrix[1, 2] = matrix[2, 1] = row[4]
    matrix[0, 2] = matrix[2, 0] = row[5]


@jit
def _jacobi(a, values, vectors):
    """Eigenvalues, and eigenvectors as rows, of a symmetric matrix (3, 3), which is overwritten."""
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    size = 0.0
    for i in range(3):
        for j in range(3):
            size = max(size, abs(a[i, j]))
    for _ in range(16):
        if abs(a[0, 1]) + abs(a[0, 2]) + abs(a[1, 2]) <= 1e-17 * size:
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if a[p, q] == 0.0:
                    continue
                k = 3 - p - q
                θ = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
                t = (1.0 if θ >= 0.0 else -1.0) / (abs(θ) + math.sqrt(θ * θ + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                a[p, p] -= t * a[p, q]
                a[q, q] += t * a[p, q]
                a[p, q] = a[q, p] = 0.0
                left, right = a[k, p], a[k, q]
                a[k, p] = a[p, k] = c * left - s * right
                a[k, q] = a[q, k] = s * left + c * right
                for i in range(3):
                    left, right = vectors[p, i], vectors[q, i]
                    vectors[p, i], vectors[q, i] = c * left - s * right, s * left + c * right
    for i in range(3):
        values[i] = a[i, i]


@jit
def _sort(values, vectors):
    for i, j in ((0, 1), (1, 2), (0, 1)):
        if values[i] < values[j]:
            values[i], values[j] = values[j], values[i]
            for k in range(3):
                vectors[i, k], vectors[j, k] = vectors[j, k], vectors[i, k]


@jit
def _decompose_space(row, room):
    values, P, S, v, matrix = room
    _fill(row, matrix)
    _jacobi(matrix, values, v)
    _sort(values, v)
    for a in range(3):
        for i in range(3):
            P[a, i] = v[a, i] * v[a, i]
        P[a, 3], P[a, 4], P[a, 5] = v[a, 0] * v[a, 1], v[a, 1] * v[a, 2], v[a, 0] * v[a, 2]
    for a, b in ((0, 1), (0, 2), (1, 2)):
        pair = a + b - 1
        for i in range(3):
            S[pair, i] = v[a, i] * v[b, i]
        S[pair, 3] = 0.5 * (v[a, 0] * v[b, 1] + v[a, 1] * v[b, 0])
        S[pair, 4] = 0.5 * (v[a, 1] * v[b, 2] + v[a, 2] * v[b, 1])
        S[pair, 5] = 0.5 * (v[a, 0] * v[b, 2] + v[a, 2] * v[b, 0])


@jit
def compose(principal, room, out):
    """Write the row of a stress with these principal values (3,), in the directions in ``room``."""
    P = room[1]
    for i in range(len(out)):
        out[i] = principal[0] * P[0, i] + principal[1] * P[1, i] + principal[2] * P[2, i]


@jit
def compose_tangent(principal, D, μ, room, out):
    """Write the tangent of the row: ``principal`` stresses (3,) after the return, D (3, 3) their
    derivative by principal strains."""
    values, P, S = room[0], room[1], room[2]
    n = len(out)
    for j in range(n):
        d0 = D[0, 0] * P[0, j] + D[0, 1] * P[1, j] + D[0, 2] * P[2, j]
        d1 = D[1, 0] * P[0, j] + D[1, 1] * P[1, j] + D[1, 2] * P[2, j]
        d2 = D[2, 0] * P[0, j] + D[2, 1] * P[1, j] + D[2, 2] * P[2, j]
        for i in range(n):
            out[i, j] = d0 * P[0, i] + d1 * P[1, i] + d2 * P[2, i]
    size = max(abs(values[0]), abs(values[2]))
    for a, b in ((0, 1), (0, 2), (1, 2)):
        pair = a + b - 1
        if n == 4 and S[pair, 3] == 0.0 and S[pair, 0] == 0.0:
            continue
        gap = values[a] - values[b]
        if gap > EQUAL * size:
            g = 4.0 * μ * (principal[a] - principal[b]) / gap
        else:
            g = D[a, a] - D[a, b] - D[b, a] + D[b, b]
        if g == 0.0:
            continue
        for i in range(n):
            for j in range(n):
                out[i, j] += g * S[pair, i] * S[pair, j]
