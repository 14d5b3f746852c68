"""Bodies on several ranks come to the rest of one rank, what their edges bore is carried over, and
what goes wrong on one rank stops all."""

import json

import numpy as np
import pytest
import statics_on_ranks
from test_ranks import on_ranks

TOLERANCE = 1e-9
"""Of the largest value of a field; the solver stops at 1e-13, Newton's method at 1e-12."""
QUICK = (
    "column 2D",
    "slope",
    "elements 2D",
    "block 3D",
    "elements of bodies",
    "given acceleration",
    "points by hand",
    "refused",
    "failing",
)

RAISES = """
import mpm_fenicsx as mpm


class Raising:
    def attach(self, run):
        pass

    def __call__(self, run):
        if run.grid.comm.rank == 1:
            raise KeyError("no such file")


soil = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)
grid = mpm.Grid.box((0, 0), (2, 1), (4, 2))
run = mpm.Simulation(grid, mpm.MaterialPoints.fill(grid, soil, 4), mpm.Newmark(1e-3))
run.record(Raising())
run.until(2e-3)
"""


def found_on(ranks: int, out, names: tuple) -> dict:
    on_ranks(ranks, statics_on_ranks.__file__, out, *names)
    return json.loads(out.read_text())


def compare(several: dict, serial: dict) -> None:
    """All fields of a case, by places and numbers."""
    assert sorted(several) == sorted(serial)
    for quantity, rows in serial.items():
        assert sorted(several[quantity]) == sorted(rows), quantity
        a, b = (np.array([found[k] for k in rows]) for found in (several[quantity], rows))
        assert np.abs(a - b).max() <= TOLERANCE * np.abs(b).max(), quantity


@pytest.fixture(scope="module")
def serial() -> dict:
    return statics_on_ranks.everything(QUICK)


@pytest.fixture(scope="module")
def two(tmp_path_factory) -> dict:
    return found_on(2, tmp_path_factory.mktemp("ranks") / "out.json", QUICK)


@pytest.mark.ranks
@pytest.mark.parametrize("case", QUICK)
def test_two_ranks_come_to_rest_and_set_bodies_free_as_one_does(two, serial, case):
    compare(two[case], serial[case])


@pytest.mark.ranks
def test_what_a_recorder_raises_on_one_rank_ends_all(tmp_path):
    script = tmp_path / "raises.py"
    script.write_text(RAISES)
    with pytest.raises(AssertionError, match="no such file"):
        on_ranks(2, script)


@pytest.mark.validation
@pytest.mark.parametrize("ranks", [2, 3])
def test_so_do_three_and_in_all_cases(ranks, tmp_path):
    names = tuple(statics_on_ranks.CASES)
    several, serial = found_on(ranks, tmp_path / "out.json", names), statics_on_ranks.everything()
    for case in names:
        compare(several[case], serial[case])
