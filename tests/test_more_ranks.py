"""Three and four ranks compute, and write, what one does: a few small scenes of each kind, in one
start of Python; ``mpiexec -n 3 python -m mpi4py test_more_ranks.py folder`` is what ranks do."""

import json
import sys
from pathlib import Path

from mpi4py import MPI

import migrating
import pytest
import ranks
from test_migration import compare
from test_output import record_all, same_cells, same_points
from test_ranks import difference, on_ranks
from vtu_readers import ByMeshio, ByVTK

STAYING = (
    "two cells",
    "twin, one cell, von Mises",
    "Hencky in statics, empty",
    "moving 2D GhostPenalty",
    "settled 2D",
    "two bodies 2D DM-GCL",
    "surfaces by hand 2D",
    "jitter 3D",
)
CROSSING = ("spinning 2D", "flying 2D, far jumps", "two cells", "lost")


def everything(folder):
    """Results on the first rank, and the points' numbers in the snapshots of one."""
    staying = ranks.everything(("refusals", *STAYING))
    crossing = migrating.everything("few", CROSSING)
    return {"staying": staying, "crossing": crossing}, record_all(folder, dims=(2,))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Results of one rank, the numbers of its points on several, and its folder."""
    folder = tmp_path_factory.mktemp("alone")
    return *everything(folder), folder


@pytest.fixture(scope="module", params=[3, 4])
def several(request, tmp_path_factory):
    """Results of several ranks, and their folder; all see the error of the last."""
    folder = tmp_path_factory.mktemp("several")
    assert on_ranks(request.param, __file__, folder).count("refused") == request.param
    return json.loads((folder / "found.json").read_text()), folder


@pytest.mark.parametrize("case", STAYING)
def test_points_that_stay(several, alone, case):
    found, expected = several[0]["staying"][case], alone[0]["staying"][case]
    for quantity, rows in expected.items():
        assert difference(found[quantity], rows) < 1e-9, quantity


@pytest.mark.parametrize("case", CROSSING)
def test_points_that_cross(several, alone, case):
    compare(several[0]["crossing"][case], alone[0]["crossing"][case])


def test_what_goes_wrong_on_one_rank_stops_all(several):
    refusals = several[0]["staying"]["refusals"]
    assert refusals and all(heard == {"": [1.0]} for heard in refusals.values())


@pytest.mark.parametrize("read", (ByVTK, ByMeshio))
def test_what_is_written(several, alone, read):
    _, numbers, one = alone
    first, last = same_points(read, 2, one, numbers, several[1])
    assert first != last
    for run in ("mpm2", "fe2"):
        for kind in ("grid", "stress"):
            same_cells(read, run, kind, one, several[1])


if __name__ == "__main__":
    found, _ = everything(sys.argv[1])
    if MPI.COMM_WORLD.rank == 0:
        Path(sys.argv[1], "found.json").write_text(json.dumps(found))
