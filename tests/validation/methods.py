"""The methods of the validation table, finite elements as None."""

import pytest

from mpm_fenicsx import DM_GCL, MAPPINGS

POINTS = (*MAPPINGS, DM_GCL)
LINEAR = tuple(mapping for mapping in POINTS if not mapping.support)
TILING = tuple(mapping for mapping in POINTS if mapping.support)

FED = (
    "linear stress is not the adjoint of composite strain: slow modes grow, by up to 3e-5 a step, "
    "free edges by more"
)
NOT_DERIVED = "Newton's matrix (the mean of ∇N ∇N over support domains) is not its derivative"
FLIES = "a single point flies off where points cross cells"
STRESS_LOST = "points that cross cells on linear shape functions lose their stress"
STRAINS_APART = "stiffness has not the strain of the points: Newton's matrix is not the derivative"
LOST = "internal force jumps where a point crosses a cell's edge: its gradient is that of one cell"
UNSTABLE = (
    "strain or stiffness that is not the adjoint of the internal force feeds a free edge on linear "
    "weights"
)
"""Reasons of more than one case."""


def over(*chosen):
    """Runs a test once for each of these, as ``mapping``."""
    return pytest.mark.parametrize("mapping", chosen, ids=name)


def name(mapping):
    return "FE" if mapping is None else str(mapping)


METHODS = over(None, *POINTS)
MAPPED = over(*POINTS)
