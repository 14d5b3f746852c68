"""Stress and strain as rows of numbers.

Plane strain keeps the out-of-plane stress: (xx, yy, zz, xy).  In 3D: (xx, yy, zz, xy, yz, xz).
Shear strains are engineering strains, so that stress @ strain is work per volume.
"""

from __future__ import annotations

import numpy as np

from .compiled import compiles, jit

SHEAR = {2: ((0, 1),), 3: ((0, 1), (1, 2), (0, 2))}


def components(dim: int) -> int:
    """Numbers in a row: 4 in plane strain, 6 in 3D."""
    return 3 + len(SHEAR[dim])


def strain(gradient: np.ndarray) -> np.ndarray:
    """Small strain of displacement gradients (n, dim, dim), as rows (n, components)."""
    n, dim, _ = gradient.shape
    if compiles(gradient):
        row = np.empty((n, components(dim)))
        _strain(gradient, row)
        return row
    row = np.zeros((n, components(dim)), gradient.dtype)
    for i in range(dim):
        row[:, i] = gradient[:, i, i]
    for k, (i, j) in enumerate(SHEAR[dim]):
        row[:, 3 + k] = gradient[:, i, j] + gradient[:, j, i]
    return row


@jit
def _strain(gradient, row):
    """ε_ii = ∂_i u_i and γ_ij = ∂_j u_i + ∂_i u_j."""
    for p in range(len(row)):
        g, ε = gradient[p], row[p]
        ε[0], ε[1], ε[2] = g[0, 0], g[1, 1], 0.0
        ε[3] = g[0, 1] + g[1, 0]
        if len(g) == 3:
            ε[2], ε[4], ε[5] = g[2, 2], g[1, 2] + g[2, 1], g[0, 2] + g[2, 0]


def dilate(strain: np.ndarray, volumetric: np.ndarray) -> np.ndarray:
    """Strain rows (n, components) with the volumetric strain (n,) in place of their own."""
    row = strain.copy()
    row[:, :3] += (volumetric - strain[:, :3].sum(axis=1))[:, None] / 3.0
    return row


def matrix(stress: np.ndarray, dim: int) -> np.ndarray:
    """In-plane stress tensors (n, dim, dim) of stress rows (n, components)."""
    full = np.zeros((len(stress), dim, dim))
    for i in range(dim):
        full[:, i, i] = stress[:, i]
    for k, (i, j) in enumerate(SHEAR[dim]):
        full[:, i, j] = full[:, j, i] = stress[:, 3 + k]
    return full


def symmetric_row(tensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Symmetric part of tensors (n, dim, dim) as rows, in the plane (xx, yy, xy), in 3D all six;
    and what is skew (n, dim, dim)."""
    dim = tensor.shape[1]
    turned = tensor.transpose(0, 2, 1)
    pairs = [*((i, i) for i in range(dim)), *SHEAR[dim]]
    symmetric, skew = 0.5 * (tensor + turned), 0.5 * (tensor - turned)
    return np.stack([symmetric[:, i, j] for i, j in pairs], axis=1), skew


def stretch(gradient: np.ndarray) -> np.ndarray:
    """det(I + gradient) (n,) of displacement gradients (n, dim, dim)."""
    if not compiles(gradient):
        F = gradient + np.eye(gradient.shape[1])
        return np.linalg.det(F)
    out = np.empty(len(gradient))
    _stretch(gradient, out)
    return out


@jit
def _stretch(gradient, out):
    """J = det(I + ∇u)."""
    for p in range(len(out)):
        g = gradient[p]
        xx, yy = 1.0 + g[0, 0], 1.0 + g[1, 1]
        out[p] = xx * yy - g[0, 1] * g[1, 0]
        if len(g) == 3:
            out[p] *= 1.0 + g[2, 2]
            out[p] += g[0, 1] * g[1, 2] * g[2, 0] + g[0, 2] * g[1, 0] * g[2, 1]
            out[p] -= xx * g[1, 2] * g[2, 1] + g[0, 2] * yy * g[2, 0]


def cofactor(gradient: np.ndarray) -> np.ndarray:
    """Cofactor J F⁻ᵀ (n, dim, dim) of F = I + displacement gradients (n, dim, dim)."""
    F = np.eye(gradient.shape[1]) + gradient
    if gradient.shape[1] == 2:
        return F[:, ::-1, ::-1] * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return np.cross(F[:, [1, 2, 0]], F[:, [2, 0, 1]])


def mean(stress: np.ndarray) -> np.ndarray:
    """Mean stress (n,), tension positive, of stress rows (n, components)."""
    return stress[:, :3].mean(axis=1)


def deviator(stress: np.ndarray) -> np.ndarray:
    """Deviators, rows (n, components), of stress rows."""
    row = stress.copy()
    row[:, :3] -= mean(stress)[:, None]
    return row


def von_mises(stress: np.ndarray) -> np.ndarray:
    """Deviatoric stress q = √(3 J₂) (n,) of stress rows (n, components)."""
    normal = stress[:, :3] - mean(stress)[:, None]
    return np.sqrt(1.5 * (normal**2).sum(axis=1) + 3.0 * (stress[:, 3:] ** 2).sum(axis=1))


def in_plane(dim: int) -> np.ndarray:
    """Components that do work in the plane: (xx, yy, xy) of a plane strain row, all six in 3D."""
    return np.array([*range(dim), *range(3, components(dim))])


def entries(size: int, symmetric: bool) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the entries of a matrix (size, size) that are carried, row by row: the
    upper triangle of a symmetric one, else all."""
    if symmetric:
        return np.triu_indices(size)
    return tuple(index.ravel() for index in np.indices((size, size)))
