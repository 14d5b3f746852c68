"""Packets of plane waves meet an absorbing layer, or dashpots, at the bottom and at the right: the
energy that comes back is that of ``analytical.reflection``, averaged over the packet's spectrum.

Packets have a spread of 1.5 wavelengths along their way and of 2 across, 16 cells a wavelength, ν =
0.25.  They are cut off at 3.5 spreads: 4e-7 of the energy on each side, which is what is left over
below.  At 70° a body has 170,000 cells: there the layer alone is asked.
"""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))
from open_boundaries_packets import measured

pytestmark = pytest.mark.validation

CUT = 5e-7
"""Of the energy: tails of the packet that are cut off."""


@pytest.mark.parametrize("degrees", [0, 20, 40, 60, 70])
@pytest.mark.parametrize("wave", ["P", "S"])
def test_a_layer_sends_back_next_to_nothing(wave, degrees):
    row = measured(wave, degrees, 0.25, 3)
    print(row)
    assert row["back"] == pytest.approx(row["expected"], rel=0.05, abs=CUT)
    assert row["back"] < 3e-5
    assert row["left"] < 1e-4  # with the packet's own slow tail


@pytest.mark.parametrize("degrees", [0, 20, 40, 60])
@pytest.mark.parametrize("wave", ["P", "S"])
def test_dashpots_send_back_what_lysmer_says(wave, degrees):
    """On the continuous ground, within 5 %, where more than a thousandth comes back; below that the
    grid adds what is as large, and theory that knows the grid is within 5 %."""
    row = measured(wave, degrees, 0.25, 0)
    print(row)
    assert row["back"] == pytest.approx(row["expected"], rel=0.05)
    if row["expected_of_ground"] > 1e-3:
        assert row["back"] == pytest.approx(row["expected_of_ground"], rel=0.05)
