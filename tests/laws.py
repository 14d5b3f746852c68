"""What any law must keep, asked at random points: for the tests of laws."""

from __future__ import annotations

import numpy as np

from mpm_fenicsx.common import tensors
from mpm_fenicsx.materials.material import NOTHING, Given, compliance


def random_states(law, count, n=2000, seed=0, pressure=60e3, sizes=(-4.0, -1.8), kappa=0.0):
    """Strain increments, stresses under pressure and state variables of points, (n, count) and (n,
    k), of which many flow; κ up to ``kappa``."""
    rng = np.random.default_rng(seed)
    stress = np.zeros((n, count))
    stress[:, :3] = -rng.uniform(0.0, pressure, (n, 1))
    history = np.zeros((n, len(law.history)))
    history[:, 0] = rng.uniform(0.0, kappa, n)
    strain = rng.normal(size=(n, count)) * 10 ** rng.uniform(*sizes, (n, 1))
    if count == 4:
        strain[:, 2] = 0.0
    return strain, stress, history


def tangent_errors(law, strain, stress, history, given: Given = NOTHING, step=1e-8):
    """Largest difference (n,) of a tangent from central differences, or from those of one side
    where the point is at a kink, per Lamé's λ + 2μ."""
    new, _, tangent = law.tangent(strain, stress, history, given)
    error = np.zeros(len(strain))
    for k in range(strain.shape[1]):
        move = step * np.eye(strain.shape[1])[k]
        above, below = (law.respond(strain + m, stress, history, given)[0] for m in (move, -move))
        slopes = (above - below) / 2, above - new, new - below
        off = [np.abs(slope / step - tangent[:, :, k]).max(axis=1) for slope in slopes]
        error = np.maximum(error, np.min(off, axis=0))
    return error / (law.lame[0] + 2 * law.lame[1])


def plastic_strain(law, strain, before, after):
    """Δεᵖ (n, components)."""
    return strain - compliance(law.lame, after - before)


def deviatoric(strain):
    """√(⅔ e:e) (n,) of the deviators of strain rows."""
    e = strain.copy()
    e[:, :3] -= e[:, :3].mean(axis=1, keepdims=True)
    return np.sqrt(2 / 3 * ((e[:, :3] ** 2).sum(axis=1) + 0.5 * (e[:, 3:] ** 2).sum(axis=1)))


def full(rows, shear=1.0):
    """Tensors (n, 3, 3) of rows (n, 6); ``shear`` 0.5 for engineering strains."""
    out = np.zeros((len(rows), 3, 3))
    for i in range(3):
        out[:, i, i] = rows[:, i]
    for k, (i, j) in enumerate(tensors.SHEAR[3]):
        out[:, i, j] = out[:, j, i] = shear * rows[:, 3 + k]
    return out


def rows_of(tensor, shear=1.0):
    """The other way."""
    pairs = [(0, 0), (1, 1), (2, 2), *tensors.SHEAR[3]]
    factor = np.array([1.0] * 3 + [1.0 / shear] * 3)
    return np.stack([tensor[:, i, j] for i, j in pairs], axis=1) * factor


def turned(rows, rotation, shear=1.0):
    """Rows (n, 6) in axes turned by ``rotation`` (3, 3)."""
    return rows_of(rotation @ full(rows, shear) @ rotation.T, shear)
