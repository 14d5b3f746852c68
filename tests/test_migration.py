"""Points, and faces of surfaces, cross from rank to rank, and compute what one rank computes."""

import json

import migrating
import numpy as np
import pytest
from test_ranks import on_ranks

TOLERANCE = 1e-9
"""Of the largest value of a field; the solver stops at 1e-13, Newton's method at 1e-12."""
FEW = tuple(migrating.few(None))
LONG = tuple(migrating.long(None))


def several_of(ranks: int, out, which: str, *names: str) -> dict:
    """What so many ranks find."""
    on_ranks(ranks, migrating.__file__, out, which, *names)
    return json.loads(out.read_text())


def compare(several: dict, serial: dict) -> None:
    """All fields of a case by the points' numbers, and that points have crossed at all."""
    assert sorted(several) == sorted(serial)
    for quantity, rows in serial.items():
        assert sorted(several[quantity]) == sorted(rows), quantity
        a, b = (np.array([found[k] for k in rows]) for found in (several[quantity], rows))
        size = np.abs(b).max(initial=0.0)
        assert np.abs(a - b).max(initial=0.0) <= TOLERANCE * size, quantity


@pytest.fixture(scope="module")
def serial() -> dict:
    return migrating.everything()


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(2, marks=pytest.mark.ranks),
        pytest.param(3, marks=pytest.mark.validation),
    ],
)
def several(request, tmp_path_factory) -> dict:
    return several_of(request.param, tmp_path_factory.mktemp("ranks") / "out.json", "few")


@pytest.mark.parametrize("case", FEW)
def test_points_that_cross_carry_what_they_carry_on_one_rank(several, serial, case):
    compare(several[case], serial[case])


def test_one_rank_has_no_numbers_and_sends_nothing():
    grid, body, _ = migrating.block(2)
    run = migrating.mpm.Simulation(grid, body, migrating.mpm.Newmark(1e-3), [])
    run.step()
    assert run.migration is None and body.number is None and "bodies/0/number" not in run.state()


@pytest.mark.validation
@pytest.mark.parametrize("ranks", [2, 3, 4])
@pytest.mark.parametrize("case", LONG)
def test_the_papers_scenes_and_a_collapse_are_those_of_one_rank(case, ranks, tmp_path):
    serial = migrating.everything("long", (case,))
    several = several_of(ranks, tmp_path / "out.json", "long", case)
    compare(several[case], serial[case])
