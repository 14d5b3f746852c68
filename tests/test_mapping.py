"""The table of methods: deposit × integrate × recover."""

import dataclasses
from itertools import product

import numpy as np
import pytest

from mpm_fenicsx import CMPM, DM, DM_C, DM_G, DM_GC, GIMP, MAPPINGS, MPM
from mpm_fenicsx.mapping.projection import AT_POINTS, DOUBLE_MAPPED


@pytest.mark.parametrize(
    "mapping, name, support, integrate, composite",
    [
        (MPM, "MPM", False, AT_POINTS, False),
        (GIMP, "GIMP", True, AT_POINTS, False),
        (CMPM, "CMPM", False, AT_POINTS, True),
        (DM, "DM", False, DOUBLE_MAPPED, False),
        (DM_G, "DM-G", True, DOUBLE_MAPPED, False),
        (DM_C, "DM-C", False, DOUBLE_MAPPED, True),
        (DM_GC, "DM-GC", True, DOUBLE_MAPPED, True),
    ],
)
def test_names_mean_what_the_literature_means(mapping, name, support, integrate, composite):
    assert (str(mapping), mapping.name) == (name, name)
    assert (mapping.support, mapping.integrate, mapping.composite) == (
        support,
        integrate,
        composite,
    )


def test_every_method_is_in_the_table_once():
    kinds = [(m.support, m.integrate.name, m.composite) for m in MAPPINGS]
    assert len({m.name for m in MAPPINGS}) == len(set(kinds)) == len(MAPPINGS) == 7
    missing = set(product((False, True), ("points", "Gauss points"), (False, True))) - set(kinds)
    assert missing == {
        (True, "points", True)
    }  # GIMP's deposit with composite strain at the points has no name


def test_a_method_is_a_value():
    with pytest.raises(dataclasses.FrozenInstanceError):
        DM_GC.support = False
    assert dataclasses.replace(DM_GC, composite=False, name="DM-G") == DM_G


@pytest.mark.parametrize("integration", [AT_POINTS, DOUBLE_MAPPED], ids=lambda i: i.name)
def test_dual_functions_hold_the_mass_of_their_nodes(integration):
    """Σ_k m_k ψ_k = 1 with m_k = ∫ of the k-th basis function on [0, 1]: what a point holds, the
    field holds."""
    m = [0.5, 0.5] if integration.degree == 1 else [1 / 6, 2 / 3, 1 / 6]
    np.testing.assert_allclose(
        m @ integration.dual, [1] + [0] * integration.degree, rtol=0, atol=1e-13
    )


def test_moment_functions_are_biorthogonal_to_quadratics():
    """∫ ψ_k g_j over [0, 1] is the nodal value of g_j: 1 for j = k, else 0."""
    ξ, w = np.polynomial.legendre.leggauss(4)
    ξ, w = (ξ + 1) / 2, w / 2
    g = np.array([(1 - ξ) * (1 - 2 * ξ), 4 * ξ * (1 - ξ), ξ * (2 * ξ - 1)])
    ψ = AT_POINTS.dual @ ξ ** np.arange(3)[:, None]
    np.testing.assert_allclose(np.einsum("kq,jq,q->kj", ψ, g, w), np.eye(3), rtol=0, atol=1e-13)
