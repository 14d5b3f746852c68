"""The elastic trial stress of one row, and the elastic stiffness, in compiled loops."""

from __future__ import annotations

from ..common.compiled import jit


@jit
def trial_stress(strain, stress, λ, μ, out):
    """Write the stress row after the increment ``strain``, were it elastic."""
    volumetric = λ * (strain[0] + strain[1] + strain[2])
    for i in range(len(strain)):
        out[i] = stress[i] + (2.0 * μ * strain[i] + volumetric if i < 3 else μ * strain[i])


@jit
def elastic_stiffness(λ, μ, out):
    """Write ∂σ/∂ε (components, components)."""
    n = len(out)
    for i in range(n):
        for j in range(n):
            out[i, j] = λ if i < 3 and j < 3 else 0.0
        out[i, i] += 2.0 * μ if i < 3 else μ
