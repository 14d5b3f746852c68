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
from test_output import record, rising, same_cells, same_points
from test_ranks import difference, on_ranks
from vtu_readers import ByMeshio, ByVTK

STAYING = (
    "two cells",
    "twin, one cell, von Mises",
    "Hencky in statics, empty",
    "two bodies 2D DM-GCL",
    "jitter 3D",
)
CROSSING = ("spinning 2D", "flying 2D, far jumps", "two cells", "lost")


def everything(folder):
    """Results on the first rank, and the points' numbers in the snapshots of one."""
    staying, crossing = ranks.everything(STAYING), migrating.everything("few", CROSSING)
    run, numbers = rising(2)
    record(run, Path(folder, "mpm2"))
    return {"staying": staying, "crossing": crossing}, numbers


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Results of one rank, the numbers of its points on several, and its folder."""
    folder = tmp_path_factory.mktemp("alone")
    return *everything(folder), folder


@pytest.fixture(scope="module", params=[3, 4])
def several(request, tmp_path_factory):
    """Results of several ranks, and their folder."""
    folder = tmp_path_factory.mktemp("several")
    on_ranks(request.param, __file__, folder)
    return json.loads((folder / "found.json").read_text()), folder


@pytest.mark.ranks
@pytest.mark.parametrize("case", STAYING)
def test_points_that_stay(several, alone, case):
    found, expected = several[0]["staying"][case], alone[0]["staying"][case]
    for quantity, rows in expected.items():
        assert difference(found[quantity], rows) < 1e-9, quantity


@pytest.mark.ranks
@pytest.mark.parametrize("case", CROSSING)
def test_points_that_cross(several, alone, case):
    compare(several[0]["crossing"][case], alone[0]["crossing"][case])


@pytest.mark.ranks
@pytest.mark.parametrize("read", (ByVTK, ByMeshio))
def test_what_is_written(several, alone, read):
    _, numbers, one = alone
    first, last = same_points(read, 2, one, numbers, several[1])
    assert first != last
    for kind in ("grid", "stress"):
        same_cells(read, "mpm2", kind, one, several[1])


if __name__ == "__main__":
    found, _ = everything(sys.argv[1])
    if MPI.COMM_WORLD.rank == 0:
        Path(sys.argv[1], "found.json").write_text(json.dumps(found))
