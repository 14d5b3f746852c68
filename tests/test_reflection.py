"""What boundaries send back of plane waves on a grid, and the cells of the absorbing layer."""

from itertools import pairwise

import numpy as np
import pytest

from mpm_fenicsx import LinearElastic
from mpm_fenicsx.analytical.reflection import Dashpots, LayerCells, reflected_energy
from mpm_fenicsx.analytical.waves import dashpot_echo
from mpm_fenicsx.terms.layer_cells import default_cells, zolotarev

ANGLES = np.radians([0, 20, 40, 60, 70, 80])


def soil(poisson):
    return LinearElastic(young=5e7, poisson=poisson, density=1900.0)


def fine(material, wave, angle, speeds):
    """Share of the energy that absorbing cells on a fixed end send back where the grid is fine.

    A wave of speed c at the angle θ takes the factor ∏ (c_k cos θ − c)/(c_k cos θ + c) on its way
    in and on its way out; the end sends it back as P and S: u = 0 at it.
    """
    fast, slow = material.p_speed, material.s_speed
    along = np.sin(angle) / (fast if wave == "P" else slow)
    p, s = np.arcsin(along * fast), np.arcsin(along * slow)
    coming = [np.cos(p), np.sin(p)] if wave == "P" else [-np.sin(s), np.cos(s)]
    going = np.array([[-np.cos(p), np.sin(s)], [np.sin(p), np.cos(s)]])
    back = np.linalg.solve(going, -np.array(coming))
    across = np.array([fast / np.cos(p), slow / np.cos(s)])  # apparent speeds along the normal
    energy = back**2 * np.array([fast * np.cos(p), slow * np.cos(s)])
    energy /= fast * np.cos(p) if wave == "P" else slow * np.cos(s)
    factors = np.prod([(k - across) / (k + across) for k in speeds], axis=0) ** 2
    return factors["PS".index(wave)] * energy @ factors


@pytest.mark.parametrize("poisson", [0.25, 0.41])
@pytest.mark.parametrize("wave", ["P", "S"])
def test_dashpots_on_a_fine_grid_are_those_of_lysmer(poisson, wave):
    for angle in np.radians([0, 10, 20, 30, 40, 50, 60, 70]):
        found = reflected_energy(soil(poisson), wave, angle, 64, Dashpots())
        assert found == pytest.approx(dashpot_echo(angle, poisson, wave), rel=0.02, abs=5e-5)


@pytest.mark.parametrize("wave", ["P", "S"])
def test_dashpots_approach_lysmers_curve_at_second_order(wave):
    exact = dashpot_echo(np.pi / 3, 0.25, wave)
    errors = [
        reflected_energy(soil(0.25), wave, np.pi / 3, n, Dashpots()) - exact for n in (32, 64)
    ]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)


@pytest.mark.parametrize("poisson", [0.25, 0.41])
@pytest.mark.parametrize("wave", ["P", "S"])
@pytest.mark.parametrize("elastic", [0, 4])
def test_three_absorbing_cells_send_back_next_to_nothing(poisson, wave, elastic):
    """With four elastic ones, the default, and without."""
    layer = LayerCells(default_cells(soil(poisson), 0.25, elastic=elastic))
    sent = [
        reflected_energy(soil(poisson), wave, np.radians(angle), 16, layer, size=0.25)
        for angle in range(0, 81, 2)
    ]
    assert max(sent) < 3.5e-5


@pytest.mark.parametrize(
    "wave, boundary, table",
    [
        ("P", "dashpots", [1e-5, 2e-3, 4e-2, 0.12, 0.35]),
        ("S", "dashpots", [1e-5, 1.5e-2, 0.11, 0.24, 0.49]),
        ("P", "three", [2e-5, 1e-5, 3e-6, 5e-7, 2e-6]),
        ("S", "three", [1e-5, 3e-6, 6e-6, 9e-7, 3e-6]),
    ],
)
def test_a_table_found_by_others(wave, boundary, table):
    """ν = 0.25, 16 cells a wavelength, 0, 40, 60, 70 and 80°; to the digits that it has."""
    cells = LayerCells(default_cells(soil(0.25), 1.0, elastic=0))
    at = Dashpots() if boundary == "dashpots" else cells
    for angle, value in zip(np.radians([0, 40, 60, 70, 80]), table, strict=True):
        found = reflected_energy(soil(0.25), wave, angle, 16, at)
        digits = len(f"{value:.9e}".split("e")[0].rstrip("0").replace(".", ""))
        assert float(f"{found:.{digits - 1}e}") == value


@pytest.mark.parametrize("poisson", [0.0, 0.25, 0.49])
@pytest.mark.parametrize("wave", ["P", "S"])
@pytest.mark.parametrize(
    "end",
    [LayerCells(), LayerCells(((1.0, 0.0),) * 3), LayerCells(((1.0, 0.0), (3.0, 0.0))),
     Dashpots(0.0, 0.0)],
    ids=["fixed", "cells like the body's", "elastic cells", "free"],
)  # fmt: skip
def test_what_absorbs_nothing_sends_all_back(poisson, wave, end):
    """P and S together: a part of each comes back as the other."""
    for angle in ANGLES:
        assert reflected_energy(soil(poisson), wave, angle, 12, end) == pytest.approx(1, abs=1e-11)


@pytest.mark.parametrize("wave", ["P", "S"])
def test_on_a_fine_grid_each_cell_takes_its_factor(wave):
    """Cells at their midpoints have the half-space's impedance whatever their lengths; with full
    quadrature they have not."""
    material, size = soil(0.3), 0.5
    speeds = zolotarev(0.92 * material.s_speed, 3 * material.p_speed, 2)
    cells = tuple((0.0, 2 * c / size) for c in speeds)
    for angle in np.radians([0, 15, 30]):
        exact = fine(material, wave, angle, speeds)
        found = reflected_energy(material, wave, angle, 1000, LayerCells(cells), size)
        assert found == pytest.approx(exact, rel=0.01)
        other = LayerCells(cells, midpoint=False)
        assert reflected_energy(material, wave, angle, 1000, other, size) > 10 * exact


def test_units_do_not_matter():
    """Cells of half the size at twice the rates, soils of one Poisson's ratio."""
    hard = LinearElastic(young=2e8, poisson=0.3, density=2000.0)
    soft = LinearElastic(young=3e6, poisson=0.3, density=1500.0)
    sent = [
        reflected_energy(s, "S", 0.7, 16, LayerCells(default_cells(s, h)), h)
        for s, h in ((hard, 2.0), (soft, 0.25))
    ]
    assert sent[0] == pytest.approx(sent[1], rel=1e-6)


def test_waves_that_are_none_are_refused():
    for wave, angle, cells, words in (
        ("SH", 0.1, 16, "wave must be P or S"),
        ("P", 2.0, 16, "angle must lie"),
        ("P", 0.1, 2, "cells_per_wavelength"),
    ):
        with pytest.raises(ValueError, match=words):
            reflected_energy(soil(0.3), wave, angle, cells, Dashpots())


# -- speeds ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 3, 5])
@pytest.mark.parametrize("ratio", [3.0, 40.0, 1e6])
def test_zolotarevs_speeds_leave_equal_peaks(count, ratio):
    """The mark of the best choice: |∏ (c − c_k)/(c + c_k)| is largest at both ends and once between
    each two speeds, equally (Chebyshev's alternation)."""
    speeds = zolotarev(1.0, ratio, count)
    assert np.all(np.diff(speeds) < 0) and np.all((speeds > 1) & (speeds < ratio))
    c = np.geomspace(1.0, ratio, 200_001)
    rest = np.prod([(c - k) / (c + k) for k in speeds], axis=0)
    edges = [0, *(len(c) - np.searchsorted(-c[::-1], -speeds))[::-1], len(c)]
    peaks = [abs(rest[a:b]).max() for a, b in pairwise(edges)]
    np.testing.assert_allclose(peaks, peaks[0], rtol=1e-5)


def test_one_speed_is_the_geometric_mean():
    assert zolotarev(2.0, 18.0, 1)[0] == pytest.approx(6.0, rel=1e-14)


def test_default_cells_from_inside_out():
    cells = default_cells(soil(0.25), 0.5)
    assert [κ for κ, _ in cells] == [0, 0, 0, 1, 3, 9, 27]
    assert all(β > 0 for _, β in cells[:3]) and all(β == 0 for _, β in cells[3:])
    speeds = np.array([β for _, β in cells[:3]]) * 0.5 / 2
    lowest, highest = 0.92 * soil(0.25).s_speed, soil(0.25).p_speed / np.cos(np.radians(80))
    np.testing.assert_allclose(speeds, zolotarev(lowest, highest, 3), rtol=1e-14)


def test_cells_of_layered_ground_serve_all_its_speeds():
    stiff = LinearElastic(young=2e8, poisson=0.45, density=2000.0)
    soft = soil(0.3)
    speeds = [β / 2 for _, β in default_cells((stiff, soft), 1.0, elastic=0)]
    highest = stiff.p_speed / np.cos(np.radians(80))
    np.testing.assert_allclose(speeds, zolotarev(0.92 * soft.s_speed, highest, 3), rtol=1e-14)


@pytest.mark.parametrize(
    "how, words",
    [
        (dict(size=0.0), "size must be positive"),
        (dict(count=0), "count must be a whole number"),
        (dict(elastic=-1), "elastic must be a whole number"),
        (dict(angle=1.6), "angle must lie between"),
    ],
)
def test_cells_that_cannot_be_are_refused(how, words):
    with pytest.raises(ValueError, match=words):
        default_cells(soil(0.25), **dict(dict(size=1.0), **how))


def test_speeds_out_of_order_are_refused():
    with pytest.raises(ValueError, match=r"lowest must be below highest = 1\.0, got 2\.0"):
        zolotarev(2.0, 1.0, 3)
