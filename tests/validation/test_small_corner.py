"""Case 13 with ``GhostPenalty``: corners, a part of a cell over grid lines in every direction, and
slivers in statics.

Exact: in statics the strain of the sliver, worth cut/4 of what the traction does, is all that may
be wrong; in dynamics a sliver of no mass goes on with the motion beside it, linearly: over one cell
with weights of 2 and -1, so that nodes have at most 3^dim of the largest acceleration that the
block has without it, whatever the cut.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from methods import LINEAR, MAPPED, TILING, over

sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))
from small_cuts_cases import drift, released, statics

from mpm_fenicsx import DM_GC, GhostPenalty

pytestmark = pytest.mark.validation

WEAK = (
    "the part `cut` of the traction falls on empty nodes; the penalty holds them with 0.03 of a "
    "cell's stiffness"
)
CUTS = 10.0 ** -np.arange(2.0, 8.5)
CURE = [GhostPenalty()]


@MAPPED
def test_statics(mapping, record):
    error = np.array([statics(cut, mapping, CURE) for cut in CUTS])
    record(
        "13 small cut with GhostPenalty, 1e-2 … 1e-8 of a cell, statics",
        mapping,
        error.max(),
        WEAK if mapping in LINEAR else "",
    )
    if mapping in LINEAR:
        assert error[0] > 0.5
        assert error[-1] < 1e-5
    else:
        assert (error < CUTS / 2).all()


@over(*TILING)
@pytest.mark.parametrize("dim", [2, 3])
def test_a_stress_set_free(dim, mapping):
    """Condition of the scaled matrix and largest acceleration, relative to those of the block
    without a corner."""
    for courant in (0.05, 0.5, 5.0):
        whole, *cut = (released("block", dim, cut, mapping, courant, CURE) for cut in (0.0, *CUTS))
        worst = {
            name: max(row[name] for row in cut) / whole[name]
            for name in ("condition", "acceleration")
        }
        assert worst["acceleration"] < 3**dim
        assert worst["condition"] < 4**dim
        assert not any(row["rescues"] for row in cut)


def test_the_foundation_between_dashpots(record):
    """Its sides drift, and their surface points lie a hair beyond the points: nodes go no further
    than the body."""
    row = drift(CURE, 300)
    record(
        "13 foundation between dashpots with GhostPenalty, 300 steps: rescues",
        DM_GC,
        row["rescues"],
    )
    assert row["stopped"] is None and row["rescues"] == 0
    assert row["furthest_node_m"] < 0.01
