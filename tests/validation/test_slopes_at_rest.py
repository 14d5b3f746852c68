"""Case 11 on bodies of any shape: slope, step, embankment, block with free sides, at three places
on the grid.

Exact: at rest the base bears the weight, and when it and the walls become dashpots that bear what
they bore, nothing moves.  A block that stands on dashpots and on what its base bore, with no
springs, tilts for good: the moment of its weight m g H/2 θ against the dashpots' Z W³/12 dθ/dt
gives exp(0.83 t/s) here, which is seen to grow from 1e-11.
"""

import numpy as np
import pytest
from methods import MAPPED

from mpm_fenicsx import DM_G, DM_GC, GIMP
from mpm_fenicsx.scenes.slope import BODIES, SOIL, WEAK, WEAK_BLOCK, AtRest

pytestmark = pytest.mark.validation

STEPS = 1000
GROWS = (
    "soil that yields at its foot drifts on dashpots, by 0.13 % more a step: from what settle "
    "leaves to 5e-7 gH/c after 3,000 steps"
)
PLACES = (0.0, 0.15, 0.3)  # of a cell


@pytest.mark.parametrize("name", BODIES)
@MAPPED
def test_it_settles_and_then_stays(name, mapping, record):
    """Von Mises that yields at the foot; with DM-GC elastic as well, at all places: the largest of
    them."""
    scenes = [(PLACES[-1], WEAK_BLOCK if name == "block" else WEAK)]
    scenes += [(place, SOIL) for place in PLACES] if mapping is DM_GC else []
    judge(
        name,
        [stays(AtRest(name, offset, mapping, soil)) for offset, soil in scenes],
        mapping,
        record,
    )


@pytest.mark.parametrize("mapping", [GIMP, DM_GC], ids=str)
def test_on_rollers(mapping, record):
    judge("slope on rollers", [stays(AtRest("slope", 0.3, mapping, base="y"))], mapping, record)


@pytest.mark.parametrize("mapping", [GIMP, DM_GC], ids=str)
def test_in_3d(mapping, record):
    judge("slope in 3D", [stays(AtRest("slope", 0.3, mapping, dim=3), steps=200)], mapping, record)


def stays(rest, steps=STEPS):
    """What the base lacks of the weight, the largest velocity (of gH/c), and that of the later half
    of the steps where it is larger than before."""
    lacks, run, fastest = abs(rest.borne()[1] - 1.0), rest.release(), []
    assert rest.left <= 1e-10
    for _ in range(steps):
        run.step()
        fastest.append(rest.fastest())
    early, late = np.max(fastest[: steps // 2]), np.max(fastest[steps // 2 :])
    return lacks, max(early, late), late if late > early else 0.0


def judge(name, found, mapping, record):
    """No velocity above 1e-4 gH/c, and none that grows, but from nothing to the drift of what
    ``settle`` leaves, 1e-10 of the forces at work."""
    lacks, fastest, grown = np.max(found, axis=0)
    grows = name == "block" and mapping in (DM_G, DM_GC)
    record(f"11 {name} at rest: weight that the base does not bear", mapping, lacks)
    record(
        f"11 {name}, fixed edges to dashpots: largest velocity, of gH/c",
        mapping,
        fastest,
        note=GROWS if grows else "",
    )
    assert lacks < 1e-10
    assert fastest < 1e-4
    assert (grown > 1e-8) if grows else (grown < 1e-8)
