"""On several ranks too, forms go over the cells with material, rows of nodes without any are not
solved for, ``reuse`` keeps, and a run goes on bit for bit: all of it as on one rank."""

import json

import following
import numpy as np
import pytest
from test_migration import compare
from test_ranks import on_ranks

from mpm_fenicsx.grid import dolfinx_versions


@pytest.fixture(scope="module")
def serial() -> dict:
    return following.everything()


@pytest.fixture(scope="module", params=[2, 3])
def several(request, tmp_path_factory) -> dict:
    out = tmp_path_factory.mktemp("ranks") / "out.json"
    on_ranks(request.param, following.__file__, out)
    return json.loads(out.read_text())


@pytest.mark.ranks
@pytest.mark.parametrize("case", list(following.CASES))
def test_ranks_compute_the_same_and_go_over_as_much(several, serial, case):
    compare(several[case], serial[case])


def test_every_state_goes_on_bit_for_bit_with_facets_between_cells(serial):
    """Zeros that the matrix has room for are filled by its incomplete factor."""
    assert serial["restart"]["the same"][""] == [1.0] * (following.AGAIN - 1)


@pytest.mark.skipif(
    not dolfinx_versions.FORMS_FOLLOW, reason="forms of DOLFINx 0.5 go over all cells"
)
def test_what_is_gone_over_is_what_holds_material(serial):
    """The block lies in 9 × 3 cells of 16 × 5, its top in 9: with those beside them 11 × 4."""
    cells, loaded, unknowns = serial["DM-GC"]["gone over"][""][:3]
    assert (cells, loaded) == (11 * 4, 9) and unknowns == 2 * 10 * 4
    steps = np.reshape(serial["reuse"]["gone over"][""], (-1, 4))
    assert (steps[1:, 2] < steps[1:, 0]).mean() > 0.8 and steps[0, 2] == steps[0, 0]
