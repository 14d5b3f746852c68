"""Case 11 on bodies of any shape: slope, step, embankment, block with free sides, each at three places on the grid.

Exact: at rest the base bears the weight, and when it and the walls become dashpots that bear what they bore, nothing
moves.
"""

import numpy as np
import pytest
from slopes import BODIES, SOIL, WEAK, WEAK_BLOCK, AtRest

from mpm_fenicsx import DM_G, DM_GC, DM_GCL, GIMP

pytestmark = pytest.mark.validation

STEPS, EVERY = 1000, 100


@pytest.mark.parametrize("yields", [False, True], ids=["elastic", "von Mises"])
@pytest.mark.parametrize("mapping", [GIMP, DM_G, DM_GC, DM_GCL], ids=str)
@pytest.mark.parametrize("offset", [0.0, 0.15, 0.3])
@pytest.mark.parametrize("name", BODIES)
def test_it_settles_and_then_stays(name, offset, mapping, yields, record):
    """No velocity above 1e-4 gH/c in 1,000 steps, and none that grows: none in the second half of the time is larger
    than the largest of the first."""
    soil = SOIL if not yields else WEAK_BLOCK if name == "block" else WEAK
    stays(AtRest(name, offset, mapping, soil), mapping, record)


@pytest.mark.parametrize("mapping", [GIMP, DM_GC], ids=str)
def test_on_rollers(mapping, record):
    stays(AtRest("slope", 0.3, mapping, SOIL, base="y"), mapping, record)


@pytest.mark.parametrize("mapping", [GIMP, DM_GC], ids=str)
def test_in_3d(mapping, record):
    stays(AtRest("slope", 0.3, mapping, SOIL, dim=3), mapping, record, steps=200)


def stays(rest, mapping, record, steps=STEPS):
    weight = abs(rest.borne()[1] - 1.0)
    record("11 bodies of any shape at rest: weight not borne", mapping, weight)
    assert rest.left <= 1e-10 and weight < 1e-10
    run, fastest = rest.release(), []
    for _ in range(steps):
        run.step()
        fastest.append(rest.fastest())
    half = steps // 2
    record("11 bodies of any shape, fixed edges to dashpots: largest velocity, of gH/c", mapping, np.max(fastest))
    assert np.max(fastest) < 1e-4
    assert np.max(fastest[half:]) <= np.max(fastest[:half])
