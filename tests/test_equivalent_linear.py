"""Equivalent-linear site response, against a published library and where it must be linear."""

import numpy as np
import pytest

from mpm_fenicsx import Hyperbolic
from mpm_fenicsx.analytical.equivalent_linear import equivalent_linear
from mpm_fenicsx.analytical.site_response import HalfSpace, Layer, LayeredGround

ROCK = HalfSpace(2300.0, 900.0, 0.005)
FIVE = LayeredGround(
    (
        Layer(1700.0, 160.0, 0.01, thickness=3.0),
        Layer(1800.0, 210.0, 0.01, thickness=4.0),
        Layer(1750.0, 190.0, 0.01, thickness=4.0),
        Layer(1900.0, 280.0, 0.01, thickness=5.0),
        Layer(2000.0, 360.0, 0.01, thickness=6.0),
    ),
    ROCK,
)
SOILS = [Hyperbolic(reference_strain=strain) for strain in (4e-4, 6e-4, 9e-4, 1e-3, 1.5e-3)]
DT = 0.01
T = DT * np.arange(1500)
OUTCROP = (
    2.0  # m/s²
    * np.exp(-(((T - 6) / 2.0) ** 2))
    * (
        np.sin(2 * np.pi * 1.3 * T)
        + 0.6 * np.sin(2 * np.pi * 3.1 * T + 0.7)
        + 0.3 * np.sin(2 * np.pi * 7.7 * T)
    )
)

# pyStrata 0.5.4: EquivalentLinearCalculator(0.65, 1e-7, 200), COMP_MODULUS_MODEL = "seed", which is
# G (1 + 2iξ), fa_length=8192, curves as 20 001 numbers from 1e-8 to 1 in even logarithms, the
# hyperbola's closed form plus 1 %.  With its own choice "dormieux", |G*| = G, the strains are
# (2.68154563, 5.38106945, 22.4932055, 5.69413376, 3.07636281)e-4 and the peaks 4.45654651 and
# 2.70523275.
PYSTRATA = np.array(  # effective strain, G/G_max, damping ratio, from the surface down
    [
        [2.81019740e-04, 5.87354485e-01, 1.21865665e-01],
        [5.51764579e-04, 5.20939791e-01, 1.46452063e-01],
        [1.86605596e-03, 3.25373034e-01, 2.38682410e-01],
        [5.97945518e-04, 6.25803558e-01, 1.08742479e-01],
        [3.23655307e-04, 8.22523852e-01, 5.14077735e-02],
    ]
)
PYSTRATA_PEAKS = 4.6896401299870485, 2.6697576926231363  # m/s², of the surface and of the base
PYSTRATA_SURFACE = np.array(  # m/s², at 5, 5.3, ... s
    [
        *(2.01340979, -1.47461757, 4.10954898, -2.01605066, -1.61307407),
        *(0.71699374, -3.9621959, 0.04491423, -1.61871681, -0.34723157),
    ]
)


def test_five_layers_come_to_what_pystrata_says():
    found = equivalent_linear(FIVE, SOILS, OUTCROP, DT, tolerance=1e-7)
    assert found.strain == pytest.approx(PYSTRATA[:, 0], rel=5e-7)
    assert found.reduction == pytest.approx(PYSTRATA[:, 1], rel=5e-7)
    assert found.damping + 0.01 == pytest.approx(PYSTRATA[:, 2], rel=5e-7)
    surface = found.ground.motion_at(0.0, OUTCROP, DT, "outcrop")
    base = found.ground.motion_at(FIVE.depth, OUTCROP, DT, "outcrop")
    peaks = np.abs(surface).max(), np.abs(base).max()
    assert peaks == pytest.approx(PYSTRATA_PEAKS, rel=5e-7)
    assert surface[500:800:30] == pytest.approx(PYSTRATA_SURFACE, abs=1e-6)


def test_what_it_comes_to_is_where_it_stays():
    """The strains of the ground that is handed back are those of its moduli."""
    found = equivalent_linear(FIVE, SOILS, OUTCROP, DT, strain_ratio=0.5, tolerance=1e-6)
    top = 0.0
    for layer, before, strain, curve in zip(
        found.ground.layers, FIVE.layers, found.strain, SOILS, strict=True
    ):
        middle = top + 0.5 * layer.thickness
        γ = 0.5 * np.abs(found.ground.strain_at(middle, OUTCROP, DT, "outcrop")).max()
        assert γ == pytest.approx(strain, rel=1e-5)
        assert (layer.speed / before.speed) ** 2 == pytest.approx(curve.reduction(γ), rel=1e-5)
        assert layer.damping == pytest.approx(0.01 + curve.damping_ratio(γ), rel=1e-4)
        top += layer.thickness


def test_weak_motion_and_layers_without_curves_stay_linear():
    found = equivalent_linear(FIVE, SOILS, 1e-6 * OUTCROP, DT)
    assert found.reduction == pytest.approx(np.ones(5), abs=1e-5)
    assert found.iterations <= 2
    found = equivalent_linear(FIVE, [None] * 5, OUTCROP, DT)
    assert found.ground == FIVE
    with_frequency = Layer(1700.0, 160.0, lambda f: 0.01 + 0.0 * f, thickness=3.0)
    ground = LayeredGround((with_frequency, *FIVE.layers[1:]), ROCK)
    by_function = equivalent_linear(ground, SOILS, OUTCROP, DT).ground.transfer([1.0, 5.0])
    by_number = equivalent_linear(FIVE, SOILS, OUTCROP, DT).ground.transfer([1.0, 5.0])
    assert by_function == pytest.approx(by_number, rel=1e-12)


class _Odd:
    reduction = staticmethod(lambda γ: 0.0 * γ)
    damping_ratio = staticmethod(lambda γ: 0.0 * γ)


def test_what_cannot_be_is_refused():
    for curves, words in (
        (SOILS[:2], "one for each of the 5 layers, or None for it, got 2"),
        ([1.0] * 5, "functions of strain reduction and damping_ratio: 1.0"),
        ([_Odd] * 5, "reduction above 0 and at most 1, .* gave 0.0 and 0.0 at the strain"),
    ):
        with pytest.raises(ValueError, match=words):
            equivalent_linear(FIVE, curves, OUTCROP, DT)
    with pytest.raises(ValueError, match=r"strain_ratio must .* got 65"):
        equivalent_linear(FIVE, SOILS, OUTCROP, DT, strain_ratio=65)
    with pytest.raises(RuntimeError, match=r"still change by .* after 2 iterations"):
        equivalent_linear(FIVE, SOILS, OUTCROP, DT, most=2)
