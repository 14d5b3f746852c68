"""Uneven grids off the origin, and hat functions on their grid lines; examples are the same every
time."""

import gc
import os

import meshio
import numpy as np
import pytest
from hats import LINES, Hats
from hypothesis import settings

# some hundred forms are compiled for scenes of a few cells: quickly, rather than well
os.environ.setdefault("MPM_FENICSX_CFLAGS", "-O1")

import mpm_fenicsx

# Runs refer to themselves, and Python looks for such objects among all that imports have made: a
# tenth of the time.  They are looked for after tests, and what was imported is left out.
gc.disable()
gc.collect()
gc.freeze()
FEW = 16
"""Tests after which all that is left is looked for."""
_ended = 0


def pytest_runtest_logfinish(nodeid, location):
    """Free what the test has left."""
    global _ended
    _ended += 1
    gc.collect(1 if _ended % FEW else 2)


# A run of the tests is the same every time; "make test ARGS=--hypothesis-profile=search" looks
# where none has looked.
settings.register_profile("same", derandomize=True)
settings.register_profile("search", derandomize=False)
settings.load_profile("same")


@pytest.fixture(scope="session", params=(2, 3), ids=("2D", "3D"))
def grid(request):
    """Uneven grid of 12 or 27 cells, none at the origin."""
    return mpm_fenicsx.Grid.rectilinear([np.array(line) for line in LINES[request.param]])


@pytest.fixture(scope="session")
def hats(grid):
    """Hat functions of that grid."""
    return Hats(grid)


@pytest.fixture(scope="session")
def l_shape(tmp_path_factory):
    """Five uneven cells of an L, [0, 3] × [0, 2] less [1, 3] × [0.5, 2], read from a file."""
    x, y = np.meshgrid([0.0, 1.0, 1.6, 3.0], [0.0, 0.5, 1.5, 2.0])
    ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
    cells = [
        [4 * (j + b) + i + a for a, b in ring]
        for j in range(3)
        for i in range(3)
        if i == 0 or j == 0
    ]
    path = tmp_path_factory.mktemp("grids") / "l.vtu"
    meshio.write(path, meshio.Mesh(np.stack((x, y, 0 * x), -1).reshape(-1, 3), [("quad", cells)]))
    return mpm_fenicsx.Grid.read(path)


@pytest.fixture(scope="session")
def soil():
    """An elastic soil."""
    return mpm_fenicsx.LinearElastic(young=5e6, poisson=0.3, density=1800.0)


@pytest.fixture
def points(grid, soil):
    """Points strewn at random over the whole grid."""
    return mpm_fenicsx.MaterialPoints.fill(grid, soil, per_cell=2**grid.dim, jitter=0.45, seed=7)
