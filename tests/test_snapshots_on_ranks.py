"""A series that another number of ranks goes on with has each step once.

As a script: ``mpiexec -n N python test_snapshots_on_ranks.py folder first``: steps 0 to 4 with a
checkpoint after 2 where it is the first, else from that checkpoint on.
"""

import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

from mpi4py import MPI

import pytest
from test_checkpoint import SOFT
from test_ranks import on_ranks

import mpm_fenicsx as mpm


def written(folder, first):
    """Write, or go on with, a series of a body on all cells."""
    grid = mpm.Grid.box((0.0, 0.0), (3.0, 1.0), (6, 2))
    body = mpm.MaterialPoints.fill(grid, SOFT, 4)
    run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), [mpm.Fixed(grid.facets("bottom"))])
    run.record(mpm.Snapshots(folder / "it"))
    keep = mpm.Checkpoint(folder / "state.npz", every=2)
    if first:
        run.record(keep)
        for _ in range(2):
            run.step()
        run.recorders.remove(keep)
    else:
        run.restart(keep.path)
    for _ in range(2):
        run.step()


def once(folder, ranks):
    """Each step has one file, which the collection names, and its pieces are those it names."""
    for kind in ("points", "grid"):
        files = sorted(file.name for file in folder.glob(f"it_{kind}_*.*vtu"))
        steps = [int(re.search(r"_(\d+)\.", file)[1]) for file in files]
        assert steps == list(range(5))
        listed = [
            entry.get("file") for entry in ET.parse(folder / f"it_{kind}.pvd").iter("DataSet")
        ]
        assert sorted(listed) == files
        # the state at the start is written again, then what comes after the checkpoint
        assert {file for file in files if file.endswith(".vtu")} >= (
            {files[0], *files[3:]} if ranks == 1 else set()
        )
        pieces = [
            folder / piece.get("Source")
            for file in files
            if file.endswith(".pvtu")
            for piece in ET.parse(folder / file).iter("Piece")
        ]
        assert set(pieces) == set((folder / f"it_{kind}").glob("*.vtu"))


@pytest.mark.ranks
def test_other_numbers_of_ranks_leave_one_file_a_step(tmp_path):
    on_ranks(3, __file__, tmp_path, "first")
    once(tmp_path, 3)
    written(tmp_path, first=False)
    once(tmp_path, 1)
    on_ranks(2, __file__, tmp_path, "")
    once(tmp_path, 2)


if __name__ == "__main__":
    written(Path(sys.argv[1]), bool(sys.argv[2]))
    MPI.COMM_WORLD.barrier()
