"""Grids on several ranks: shares of the weight, the same cells, nodes, facets and points as on one,
and a new partition in place."""

import json

from mpi4py import MPI

import numpy as np
import partitions
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_ranks import on_ranks

from mpm_fenicsx import Grid
from mpm_fenicsx.grid import partition


def bisected(centre, number, weight, ranks):
    """Owners by sorting all cells, whole weights."""
    owner = np.zeros(len(centre), dtype=int)

    def cut(cells, first, ranks, directions):
        if ranks == 1:
            owner[cells] = first
            return
        longest = int(np.argmax(np.ptp(centre[cells], axis=0))) if len(cells) else 0
        directions = [longest, *(d for d in directions if d != longest)]
        keys = [number[cells], *(centre[cells, d] for d in reversed(directions))]
        order, half = cells[np.lexsort(keys)], ranks // 2
        weighs = weight[order] if weight[order].any() else np.ones(len(order), int)
        end = int((ranks * np.cumsum(weighs) <= half * weighs.sum()).sum())
        cut(order[:end], first, half, directions)
        cut(order[end:], first + half, ranks - half, directions)

    cut(np.arange(len(centre)), 0, ranks, [])
    return owner


@st.composite
def scattered_cells(draw):
    """Centres with many ties, numbers, whole weights and a number of ranks."""
    dim, n = draw(st.sampled_from((2, 3))), draw(st.integers(0, 60))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    centre = rng.integers(-3, 4, (n, dim)) * rng.choice([0.1, 1.0, 7.0], dim)
    if draw(st.booleans()):
        centre = centre + rng.normal(size=centre.shape)
    weight = rng.integers(0, draw(st.sampled_from((1, 2, 9))), n)
    return centre, rng.permutation(3 * n)[:n], weight, draw(st.integers(1, 13))


@settings(max_examples=100, deadline=None)
@given(cells=scattered_cells())
def test_owners_are_those_of_sorting_all_cells(cells):
    centre, number, weight, ranks = cells
    # whole multiples of a weight of the largest share that whole floats take
    weight = np.append(weight, 0)[: len(weight)]
    scale = 2**52 // max(len(weight), 1)
    exact = np.rint(weight / max(weight.max(initial=0), 1) * scale).astype(object)
    found = partition.owners(MPI.COMM_SELF, centre, number, weight, ranks)
    assert np.array_equal(found, bisected(centre, number, exact, ranks))


def test_equal_weights_give_parts_of_as_many_cells_whatever_they_weigh():
    rng = np.random.default_rng(0)
    centre, number = rng.normal(size=(1000, 3)), np.arange(1000)
    ones = partition.owners(MPI.COMM_SELF, centre, number, np.ones(1000), 7)
    tenths = partition.owners(MPI.COMM_SELF, centre, number, np.full(1000, 0.1), 7)
    assert np.array_equal(ones, tenths) and np.ptp(np.bincount(ones)) <= 1


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), ranks=st.integers(2, 9))
def test_a_cut_misses_its_share_by_no_more_than_a_cell(seed, ranks):
    rng = np.random.default_rng(seed)
    centre, weight = rng.uniform(size=(200, 2)), rng.exponential(size=200) ** 3
    owner = partition.owners(MPI.COMM_SELF, centre, np.arange(200), weight, ranks)
    below, share = weight[owner < ranks // 2].sum(), weight.sum() * (ranks // 2) / ranks
    hair = 1e-9 * weight.sum()
    assert share - weight.max() - hair <= below <= share + hair


SPREAD = """
import sys
from mpi4py import MPI
import numpy as np
from mpm_fenicsx.grid import partition
comm = MPI.COMM_WORLD
for seed, n in enumerate((0, 1, 2, 40, 90, 90)):
    rng = np.random.default_rng(seed)
    centre = np.round(rng.uniform(-2, 3, (n, 2 + seed % 2)), 1)
    number, weight = rng.permutation(2 * n)[:n], rng.exponential(size=n) ** 2
    node = rng.integers(0, 2 * n + 4, (n, 4))
    whole = partition.owners(MPI.COMM_SELF, centre, number, weight, comm.size)
    offsets, ghosts = partition.destinations(MPI.COMM_SELF, node, whole)
    have = np.flatnonzero(rng.integers(0, comm.size, n) == comm.rank)
    if seed == 4:  # all on the last rank
        have = np.arange(n) if comm.rank == comm.size - 1 else have[:0]
    here = partition.owners(comm, centre[have], number[have], weight[have], comm.size)
    assert np.array_equal(here, whole[have]), seed
    at, to = partition.destinations(comm, node[have], here)
    for row, a, b in zip(have, at[:-1], at[1:]):
        assert np.array_equal(to[a:b], ghosts[offsets[row]:offsets[row + 1]]), (seed, row)
        touching = np.isin(node, node[row]).any(axis=1)
        assert sorted(to[a:b]) == sorted(set(whole[touching].tolist()))
print("fine")
"""


@pytest.mark.ranks
@pytest.mark.parametrize("ranks", [2, 3, 4])
def test_it_does_not_matter_which_rank_has_which_cell(ranks):
    assert on_ranks(ranks, "-c", SPREAD).count("fine") == ranks


# -- grids -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def serial(tmp_path_factory) -> dict:
    return json.loads(json.dumps(partitions.everything(tmp_path_factory.mktemp("serial"))))


@pytest.fixture(scope="module", params=[2, 3])
def several(request, tmp_path_factory) -> dict:
    folder = tmp_path_factory.mktemp("several")
    on_ranks(request.param, partitions.__file__, folder / "out.json", folder)
    return json.loads((folder / "out.json").read_text())


@pytest.mark.ranks
@pytest.mark.parametrize("case", partitions.grids(None))
def test_cells_nodes_facets_and_points_are_those_of_one_rank(several, serial, case):
    assert sorted(several[case]) == sorted(serial[case])
    for quantity, rows in serial[case].items():
        assert sorted(several[case][quantity]) == sorted(rows), quantity
        found, expected = (
            np.array([of[key] for key in rows]) for of in (several[case][quantity], rows)
        )
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14, err_msg=quantity)


def test_numbers_of_a_box_are_places_in_it():
    grid = Grid.box((0, 0, 0), (3, 2, 4), (3, 2, 4))
    x = np.rint(grid.space.tabulate_dof_coordinates()).astype(int)
    assert np.array_equal(grid.node_numbers, x @ (1, 4, 12))
    assert np.array_equal(grid.cell_numbers, np.rint(grid.lattice.lower).astype(int) @ (1, 3, 6))
    assert len(np.unique(grid.facet_numbers)) == 4 * 8 + 3 * 3 * 4 + 3 * 2 * 5
    assert set(grid.facet_numbers // 6) == set(grid.cell_numbers)
