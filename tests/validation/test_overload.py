"""The strip of demos/foundation.py overloaded: 60 kPa and held, on soil that softens from c = 10 to
3 kPa.

No equilibrium: the soil bears (2 + π) c = 51 kPa at its peak, and softened, however deep, at most
(2 + 2π) c = 25 kPa. A right run goes on sinking and finds the work of the load again, less what its
steps dissipate.
"""

import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from methods import FLIES, LINEAR, LOST, METHODS, NOT_DERIVED, POINTS, STRAINS_APART, name, over

import mpm_fenicsx as mpm

sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))
import overload

pytestmark = pytest.mark.validation

STOPS = {mpm.GIMP: NOT_DERIVED, mpm.CMPM: STRAINS_APART}
BALANCE = {
    None: 1e-4,
    mpm.MPM: 0.041,
    mpm.DM: 0.12,
    mpm.DM_G: 0.039,
    mpm.DM_C: 0.145,
    mpm.DM_GC: 0.047,
    mpm.DM_GCL: 0.135,
}
"""Bounds of the work that is not found at 5 ms, of all of it: what each loses or gains by now."""
BEARS_MORE = (
    "a traction is per area as it is: the crater's walls stretch, bear more, and stretch the "
    "faster (DeadLoad)"
)


@pytest.mark.parametrize(
    ("mapping", "dt"),
    [*product((None, *POINTS), (5e-3,)), *product((mpm.DM_G, mpm.DM_GC), (1.25e-3,))],
    ids=name,
)
def test_the_strip_sinks_on_and_its_energy_balances(mapping, dt, record):
    """What steps of 5 ms dissipate where accelerations are not corrected, a tenth of the work,
    falls with them; corrected, DM-G loses 4 % at 5 ms and at 1.25 ms.  DM-GC gains 4 % of the work
    at both, for its composite strain is not the one that its force works on: uncorrected its steps
    dissipate more than that.  Ties of light nodes cost DM-GCL 0.9 % (12.7 % against 11.8 %).
    Finite elements, whose velocities stay on the grid, lose none."""
    row = overload.measure(mapping, cell=0.25, dt=dt)
    lost = np.array(row["lost_j"]) / row["work_j"][-1]
    case = f"15 strip overloaded to 60 kPa, Δt = {1e3 * dt:g} ms: work not found"
    if mapping in STOPS:
        record(case, mapping, None, STOPS[mapping])
        assert "Newton does not converge" in row["stopped"]
        return
    record(case, mapping, abs(lost).max())
    assert row["stopped"] is None
    t, down = np.array(row["t"]), np.array(row["settlement_m"])
    assert down[-1] > 0.9
    assert (np.diff(down[t > 0.3]) > 0.0).all()
    assert (
        mapping is None or row["half_per_cell"] > 0.7
    )  # domains have outgrown the half cell where they end
    assert abs(lost).max() < (BALANCE[mapping] if dt == 5e-3 else 0.041)


@over(*POINTS)
def test_while_strains_are_small_it_sinks_like_finite_elements(mapping, record):
    twin, row = (overload.measure(m, until=0.3, cell=0.125) for m in (None, mapping))
    error = row["settlement_m"][-1] / twin["settlement_m"][-1] - 1.0
    lost = LOST if mapping in LINEAR else ""
    record("15 strip overloaded, settlement at 0.3 s against FE", mapping, abs(error), lost)
    assert 0.03 < error < 0.08 if mapping in LINEAR else abs(error) < 0.02


@METHODS
def test_below_its_capacity_it_stands(mapping, record):
    """45 of 51 kPa, no softening: it comes down by a seventh of a cell and swings about that."""
    law = mpm.VonMises(overload.foundation.elastic, 10e3, 10e3, 0.0)
    row = overload.measure(mapping, until=1.2, pressure=45e3, cell=0.125, law=law)
    t, down = np.array(row["t"]), np.array(row["settlement_m"])
    drift = abs(down[t > 0.9].mean() - down[(t > 0.6) & (t <= 0.9)].mean())
    record(
        "15 strip at 45 of 51 kPa: drift in 0.3 s, of the settlement", mapping, drift / down.max()
    )
    assert row["stopped"] is None
    assert down.max() < (0.1 if mapping in LINEAR else 0.08)
    assert drift < 0.003


@pytest.mark.parametrize(
    "mapping, load, note",
    [
        (mpm.DM_GC, mpm.Traction, BEARS_MORE),
        (mpm.GIMP, mpm.DeadLoad, NOT_DERIVED),
        (mpm.MPM, mpm.DeadLoad, FLIES),
    ],
    ids=str,
)
def test_what_breaks_down_says_so(mapping, load, note, record):
    """A point of MPM has 200 times the median speed when its run stops, at 0.5 s; with light nodes
    on their own it turned inside out at 0.35 s."""
    row = overload.measure(mapping, load, cell=0.125)
    lost = row["lost_j"][-1] / row["work_j"][-1]
    record(
        f"15 strip overloaded to 60 kPa, {load.__name__}, h = 0.125 m: work not found",
        mapping,
        abs(lost),
        note,
    )
    assert ("turns inside out" if mapping is mpm.DM_GC else "Newton does not converge") in row[
        "stopped"
    ]
    if load is mpm.Traction:
        assert row["t"][-1] > 0.6
        assert row["area_m2"][len(row["t"]) - 1] > 10.0
        assert row["work_j"][-1] > 10 * 60e3 * max(
            row["settlement_m"]
        )  # the load's own, not energy out of nothing
        assert abs(lost) < 0.02
