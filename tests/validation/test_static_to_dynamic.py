"""Case 11: a column at rest under gravity whose fixed base becomes a dashpot.

Exact: with what the base bore as a traction nothing moves; without it the column drifts at σ/(ρc).
"""

import numpy as np
import pytest
from methods import LINEAR, METHODS
from test_switch import SOIL, RestingColumn

from mpm_fenicsx import ViscousBoundary

pytestmark = pytest.mark.validation


@METHODS
def test_with_its_reactions_nothing_moves(mapping, record):
    column = RestingColumn(mapping)
    surfaces = column.surfaces(walls=False)
    run = column.release(
        surfaces, column.static.reactions(*surfaces) + [ViscousBoundary(s, SOIL) for s in surfaces]
    )
    fastest = 0.0
    for _ in range(200):
        run.step()
        fastest = max(fastest, np.abs(column.velocity(run)).max() / column.speed)
    record("11 static to dynamic with reactions: largest velocity, of σ/(ρc)", mapping, fastest)
    assert fastest < 1e-9


@METHODS
def test_without_them_the_column_drifts(mapping, record):
    """All of it alike, once the unloading has been to the top and back three times.

    What is left is the tail of the front: 3 % on 12 elements, a thirtieth of it where points
    average, a tenth without domains.  The base comes a fifth of a cell past a grid line, where the
    light nodes follow the column: on their own, points without domains fell freely until they had
    crossed the line, too.
    """
    column = RestingColumn(mapping)
    surfaces = column.surfaces(walls=False)
    run = column.release(surfaces, [ViscousBoundary(s, SOIL) for s in surfaces])
    run.until(0.145)
    assert run.time > 3 * (2 * column.height / SOIL.p_speed)
    error = 0.0
    while run.time < 0.2:
        run.step()
        error = max(error, np.abs(column.velocity(run)[:, 1] / -column.speed - 1).max())
    record("11 static to dynamic without reactions: every point drifts at σ/(ρc)", mapping, error)
    assert error < (0.03 if mapping is None else 0.0037 if mapping in LINEAR else 0.0011)
