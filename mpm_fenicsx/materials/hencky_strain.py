"""Hencky's strain ε = ½ ln b and what follows from it, in compiled loops over pairs of a
deformation and a state.

The elastic left Cauchy-Green tensor goes from B to b = f B fᵀ in a step with the deformation f.  B
- 1, f - 1 and b - 1 are what is kept, so that strains of 1e-9 have all their digits.  Given the
Kirchhoff stress τ(ε) and its derivative D, the nominal stress in the configuration of a deformation
F, P = s τ F⁻ᵀ, changes by

    dP = s (D : dε - τ lᵀ) F⁻ᵀ,   l = df f⁻¹ = dF F⁻¹,   dε = L : (l b + b lᵀ),   L = ½ ∂ln b/∂b

and in the eigenvectors of b, L multiplies the component ab by ½ (ln b_a - ln b_b)/(b_a - b_b), or
½/b_a where they are equal (Ogden, Non-linear elastic deformations, 1984, section 3.4).
"""

from __future__ import annotations

import math

import numpy as np

from ..common.compiled import inlined, jit


@jit
def eigen(b, values, vectors):
    """Eigenvalues and eigenvectors (columns) of a symmetric matrix, which is overwritten
    (Jacobi)."""
    n = len(b)
    small = 0.0
    for i in range(n):
        for j in range(n):
            vectors[i, j] = 1.0 if i == j else 0.0
            small = max(small, 1e-17 * abs(b[i, j]))
    turned = True
    sweeps = 0
    while turned and sweeps < 30:
        turned = False
        sweeps += 1
        for p in range(n - 1):
            for q in range(p + 1, n):
                if abs(b[p, q]) <= small:
                    continue
                turned = True
                θ = (b[q, q] - b[p, p]) / (2.0 * b[p, q])
                t = (1.0 if θ >= 0.0 else -1.0) / (abs(θ) + math.sqrt(θ * θ + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(n):
                    left, right = b[k, p], b[k, q]
                    b[k, p], b[k, q] = c * left - s * right, s * left + c * right
                for k in range(n):
                    left, right = b[p, k], b[q, k]
                    b[p, k], b[q, k] = c * left - s * right, s * left + c * right
                    left, right = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = c * left - s * right, s * left + c * right
    for i in range(n):
        values[i] = b[i, i]


@jit
def inverse(F, out):
    """Write F⁻¹ and return det F."""
    if len(F) == 2:
        det = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
        out[0, 0], out[0, 1], out[1, 0], out[1, 1] = (
            F[1, 1] / det,
            -F[0, 1] / det,
            -F[1, 0] / det,
            F[0, 0] / det,
        )
        return det
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for m in range(3):
            n, o = (m + 1) % 3, (m + 2) % 3
            out[m, i] = F[j, n] * F[k, o] - F[j, o] * F[k, n]
    det = F[0, 0] * out[0, 0] + F[0, 1] * out[1, 0] + F[0, 2] * out[2, 0]
    out /= det
    return det


@jit
def exponential(strain, shear, out):
    """Write the in-plane part of B - 1 = exp(2ε) - 1 (n, dim, dim) of elastic strain rows."""
    n, dim, _ = out.shape
    values, vectors, ε = np.empty(dim), np.empty((dim, dim)), np.empty((dim, dim))
    for p in range(n):
        for i in range(dim):
            ε[i, i] = strain[p, i]
        for k in range(len(shear)):
            i, j = shear[k]
            ε[i, j] = ε[j, i] = 0.5 * strain[p, 3 + k]
        eigen(ε, values, vectors)
        for i in range(dim):
            for j in range(dim):
                s = 0.0
                for a in range(dim):
                    s += math.expm1(2.0 * values[a]) * vectors[i, a] * vectors[j, a]
                out[p, i, j] = s


@jit
def trial(h, state, pairs, shear, out):
    """Write Hencky's strain of b = f B fᵀ, as rows, and the eigenvalues and eigenvectors of b.

    Pair m takes h = f - 1 from row at[m] and the state E = B - 1, ``across`` (in plane strain ε_zz)
    from row of[m]; ``state`` (E, across), ``pairs`` (at, of); written are ``out`` (strain, values,
    vectors).
    """
    E, across = state
    at, of = pairs
    strain, values, vectors = out
    dim = h.shape[1]
    left, b = np.empty((dim, dim)), np.empty((dim, dim))
    for m in range(len(at)):
        g, p = at[m], of[m]
        for i in range(dim):
            for j in range(dim):
                left[i, j] = h[g, i, j]
                for k in range(dim):
                    left[i, j] += h[g, i, k] * E[p, k, j]
        for i in range(dim):
            for j in range(i + 1):
                s = E[p, i, j] + left[i, j] + left[j, i]
                for k in range(dim):
                    s += left[i, k] * h[g, j, k]
                b[i, j] = b[j, i] = s
        eigen(b, values[m], vectors[m])
        N = vectors[m]
        strain[m, 2] = across[p]
        for i in range(dim):
            strain[m, i] = 0.0
            for a in range(dim):
                strain[m, i] += 0.5 * math.log1p(values[m, a]) * N[i, a] ** 2
        for k in range(len(shear)):
            i, j = shear[k]
            strain[m, 3 + k] = 0.0
            for a in range(dim):
                strain[m, 3 + k] += math.log1p(values[m, a]) * N[i, a] * N[j, a]
        for a in range(dim):
            values[m, a] += 1.0


@inlined
def _log_rate(axes, k, l, b, N, θ, Z, out):
    """Write L : (l b + b lᵀ) for l with the one component kl, as a matrix."""
    dim = len(axes)
    for c in range(dim):
        for i in range(dim):
            Z[i, c] = 0.0
        for a in range(dim):
            y = θ[a, c] * (N[k, a] * b[c] * N[l, c] + b[a] * N[l, a] * N[k, c])
            for i in range(dim):
                Z[i, c] += N[i, a] * y
    for i in range(dim):
        for j in range(i + 1):
            s = 0.0
            for c in range(dim):
                s += Z[i, c] * N[j, c]
            out[i, j] = out[j, i] = s


@jit
def _spatial(layout, stress, D, values, N, work, row, out):
    """Write T, the stress as a matrix, and a of dτ - τ lᵀ = a : l, rows and columns ij in the order
    i dim + j.

    ``layout`` as in ``nominal``; ``work`` (T, θ, Y, Z), matrices to work in.
    """
    axes, shear, plane = layout
    T, θ, Y, Z = work
    dim = len(axes)
    for i in range(dim):
        T[i, i] = stress[i]
        for j in range(dim):
            x = (values[i] - values[j]) / values[j]
            θ[i, j] = 0.5 / values[j] * (math.log1p(x) / x if x != 0.0 else 1.0)
    for k in range(len(shear)):
        i, j = shear[k]
        T[i, j] = T[j, i] = stress[3 + k]
    for k in range(dim):
        for l in range(dim):
            _log_rate(axes, k, l, values, N, θ, Z, Y)
            for i in range(dim):
                row[i] = Y[i, i]
            for c in range(len(shear)):
                row[dim + c] = Y[shear[c, 0], shear[c, 1]] + Y[shear[c, 1], shear[c, 0]]
            for c in range(len(plane)):
                s = 0.0
                for e in range(len(plane)):
                    s += D[plane[c], plane[e]] * row[e]
                if c < dim:
                    out[c * dim + c, k * dim + l] = s
                else:
                    i, j = shear[c - dim]
                    out[i * dim + j, k * dim + l] = out[j * dim + i, k * dim + l] = s
            for i in range(dim):
                out[i * dim + k, k * dim + l] -= T[i, l]


@jit
def nominal(layout, F, scale, pairs, law, eigen, out_stress, out_tangent):
    """Write P = s τ F⁻ᵀ, rows (m, dim²), and its derivative, rows (m, dim⁴) or, of a symmetric one,
    the upper triangle (m, dim² (dim² + 1)/2), whichever has room.

    ``layout``: (axes, shear, plane), axes as in ``kernels``, pairs of directions of shear, and the
    components in the plane; ``pairs``: which F and which state each is of; ``law``: τ (m,
    components) and its derivative by Hencky's strain, of every pair; ``eigen``: eigenvalues and
    eigenvectors of b; ``scale``: s of every state.  Where F turns the body inside out they are not
    numbers.
    """
    axes, _, plane = layout
    at, of = pairs
    stress, D = law
    values, vectors = eigen
    dim = len(axes)
    n = dim * dim
    whole = out_tangent.shape[1] == n * n
    T, θ, Y, Z, G = np.empty((5, dim, dim))
    row, a, half = np.empty(len(plane)), np.empty((n, n)), np.empty((n, n))
    for m in range(len(at)):
        det = inverse(F[at[m]], G)
        s = scale[of[m]] if det > 0.0 else np.nan
        _spatial(layout, stress[m], D[m], values[m], vectors[m], (T, θ, Y, Z), row, a)
        for i in range(dim):
            for J in range(dim):
                t = 0.0
                for j in range(dim):
                    t += T[i, j] * G[J, j]
                out_stress[m, i * dim + J] = s * t
        for r in range(n):
            for k in range(dim):
                for L in range(dim):
                    t = 0.0
                    for l in range(dim):
                        t += a[r, k * dim + l] * G[L, l]
                    half[r, k * dim + L] = s * t
        c = 0
        for i in range(dim):
            for J in range(dim):
                for col in range(0 if whole else i * dim + J, n):
                    t = 0.0
                    for j in range(dim):
                        t += half[i * dim + j, col] * G[J, j]
                    out_tangent[m, c] = t
                    c += 1


@jit
def by_means(layout, scale, pairs, law, eigen, carried, out_stress, out_tangent):
    """Write stress and tangent against l = df f⁻¹ and θ = d ln det f of the cell (F-bar), where the
    volume's part of dε is θ's: dε = L : (l b + b lᵀ) + ⅓ (θ - tr l) 1.

    Rows are ij, in the order i dim + j, and one more: of stress s dev τ and s p, p the mean of τ;
    of the tangent the derivative of dev τ : l + p θ, l being that of the virtual motion, but for
    -p tr(l l) of the cell, in the order of ``carried`` (rows, columns).  The rest as in
    ``nominal``, ``scale``, of every state, being s.
    """
    axes, shear, _ = layout
    at, of = pairs
    stress, D = law
    values, vectors = eigen
    row, column = carried
    dim, count = len(axes), D.shape[1]
    n = dim * dim
    T, θ, Y, Z = np.empty((4, dim, dim))
    dε, dτ, whole = np.empty(count), np.empty(count), np.empty((n + 1, n + 1))
    for m in range(len(at)):
        s, b, N = scale[of[m]], values[m], vectors[m]
        mean = (stress[m, 0] + stress[m, 1] + stress[m, 2]) / 3.0
        for i in range(dim):
            T[i, i] = stress[m, i] - mean
            for j in range(dim):
                x = (b[i] - b[j]) / b[j]
                θ[i, j] = 0.5 / b[j] * (math.log1p(x) / x if x != 0.0 else 1.0)
        for k in range(len(shear)):
            i, j = shear[k]
            T[i, j] = T[j, i] = stress[m, 3 + k]
        for k in range(dim):
            for l in range(dim):
                _log_rate(axes, k, l, b, N, θ, Z, Y)
                for i in range(count):
                    dε[i] = 0.0
                for i in range(dim):
                    dε[i] = Y[i, i]
                for c in range(len(shear)):
                    dε[3 + c] = Y[shear[c, 0], shear[c, 1]] + Y[shear[c, 1], shear[c, 0]]
                if k == l:
                    for i in range(3):
                        dε[i] -= 1.0 / 3.0
                _column(layout, D[m], dε, dτ, whole, k * dim + l)
                for i in range(dim):
                    whole[i * dim + k, k * dim + l] -= T[i, l]
        for i in range(count):
            dε[i] = 1.0 / 3.0 if i < 3 else 0.0
        _column(layout, D[m], dε, dτ, whole, n)
        for i in range(dim):
            for j in range(dim):
                out_stress[m, i * dim + j] = s * T[i, j]
        out_stress[m, n] = s * mean
        for e in range(len(row)):
            out_tangent[m, e] = s * whole[row[e], column[e]]


@jit
def _column(layout, D, dε, dτ, out, column):
    """Write D : dε as a column: its deviator in the plane, and its mean."""
    axes, shear, _ = layout
    dim, n = len(axes), len(axes) * len(axes)
    for i in range(len(dε)):
        dτ[i] = 0.0
        for j in range(len(dε)):
            dτ[i] += D[i, j] * dε[j]
    mean = (dτ[0] + dτ[1] + dτ[2]) / 3.0
    for i in range(dim):
        out[i * dim + i, column] = dτ[i] - mean
    for c in range(len(shear)):
        i, j = shear[c]
        out[i * dim + j, column] = out[j * dim + i, column] = dτ[3 + c]
    out[n, column] = mean


@jit
def push(axes, F, stress, tangent, carried):
    """Bring rows against l at Gauss points, in place, to rows against ∇u = l F (points, dim²),
    where F (points, dim, dim) is; the last row, of θ, stays what it is."""
    row, column, symmetric = carried
    dim = len(axes)
    n = dim * dim
    G = np.empty((dim, dim))
    whole, half = np.zeros((n + 1, n + 1)), np.empty((n + 1, n + 1))
    line = np.empty(n)
    for g in range(len(F)):
        some = False
        for e in range(len(row)):
            value = tangent[g, e]
            some |= value != 0.0
            whole[row[e], column[e]] = value
            if symmetric:
                whole[column[e], row[e]] = value
        for r in range(n + 1):
            some |= stress[g, r] != 0.0
        if not some:
            continue
        if not inverse(F[g], G) > 0.0:
            G[:] = np.nan
        for i in range(dim):
            for J in range(dim):
                line[i * dim + J] = 0.0
                for j in range(dim):
                    line[i * dim + J] += stress[g, i * dim + j] * G[J, j]
        for r in range(n):
            stress[g, r] = line[r]
        for r in range(n + 1):
            half[r, n] = whole[r, n]
            for k in range(dim):
                for L in range(dim):
                    t = 0.0
                    for l in range(dim):
                        t += whole[r, k * dim + l] * G[L, l]
                    half[r, k * dim + L] = t
        for c in range(n + 1):
            whole[n, c] = half[n, c]
            for i in range(dim):
                for J in range(dim):
                    t = 0.0
                    for j in range(dim):
                        t += half[i * dim + j, c] * G[J, j]
                    whole[i * dim + J, c] = t
        for e in range(len(row)):
            tangent[g, e] = whole[row[e], column[e]]
