"""Where absorbing layers must be refused and where they may stand: eigenvalues of small bodies.

Units of growth are c_s/h: 0.01 is a factor of e in 100 passages of a shear wave through a cell.
"""

import numpy as np
import pytest

from mpm_fenicsx import LinearElastic
from mpm_fenicsx.analytical.layer_stability import growth, system
from mpm_fenicsx.terms.layer_cells import default_cells

NONE = 1e-9
ABSORBING_ONLY = dict(count=3, elastic=0)


def soil(poisson, shear=1.0):
    return LinearElastic(young=2 * (1 + poisson) * shear, poisson=poisson, density=1.0)


def layers(sides, poisson=0.25, size=1.0, **how):
    cells = default_cells(soil(poisson), size, **(how or ABSORBING_ONLY))
    return dict.fromkeys(sides, cells)


# -- must be refused -------------------------------------------------------------------------------


@pytest.mark.parametrize("poisson", [0.0, 0.25, 0.41])
@pytest.mark.parametrize("walls", [None, "roller", "shear", "fixed"])
def test_one_open_side_between_walls_grows(poisson, walls):
    held = {side: walls for side in ("left", "right") if walls}
    assert growth(soil(poisson), (5, 4), layers(["bottom"], poisson), held) > 1e-3


@pytest.mark.parametrize("poisson", [0.0, 0.25, 0.41])
@pytest.mark.parametrize("base", ["fixed", "roller"])
def test_left_and_right_over_a_base_grow(poisson, base):
    """Elastic cells slow it and do not cure it."""
    for elastic in (0, 2):
        cells = layers(["left", "right"], poisson, count=3, elastic=elastic)
        assert growth(soil(poisson), (4, 4), cells, {"bottom": base}) > 1e-3


def test_a_plane_of_symmetry_is_no_second_open_side():
    walls = {"right": "roller", "bottom": "fixed"}
    assert growth(soil(0.25), (4, 4), layers(["left"]), walls) > 1e-3


def strata(top, base, contrast, rows=(6, 3), width=1, **how):
    """Growth of ``rows`` rows over others of a shear modulus ``contrast`` times as high,
    with layers at left and bottom and symmetry at right."""
    above, below = soil(top), soil(base, contrast)
    cells = default_cells((above, below), 1.0, **how)
    ground = [below] * rows[1] + [above] * rows[0]
    return growth(ground, (width, sum(rows)), dict(left=cells, bottom=cells), {"right": "roller"})


def test_stiff_over_soft_grows():
    """The default's elastic cells put it off, from a modulus of four times to one of eight."""
    assert strata(0.0, 0.3, 1 / 4, (3, 3), width=2, elastic=0) > 1e-2
    assert strata(0.25, 0.25, 1 / 10, (3, 3), width=2, elastic=0) > 1e-2
    assert strata(0.0, 0.3, 1 / 8) > 1e-2


def test_soft_over_much_stiffer_grows_too():
    """A stiff base is nearly a fixed one, over which left and right grow."""
    assert strata(0.45, 0.45, 100, (3, 3), width=2, elastic=0) > 1e-2
    assert strata(0.25, 0.25, 64) > 1e-3


def test_layered_ground_grows_without_elastic_cells():
    """Under the free surface of a narrow body even where c_s differs by a quarter."""
    lower, upper = soil(0.25), soil(0.25, 1.29**2)
    for elastic, least, most in ((0, 1e-3, 1.0), (2, -1.0, NONE)):
        cells = default_cells((lower, upper), 1.0, elastic=elastic)
        ground = [lower] * 3 + [upper] * 3
        assert least < growth(ground, (1, 6), dict(left=cells, bottom=cells)) < most


def test_a_layered_column_grows():
    """One cell wide: what moves its sides against each other is caught in soft rows over stiff."""
    rows = [soil(0.41, 10.0)] * 4 + [soil(0.3)] * 4
    cells = {"bottom": default_cells(tuple(rows), 1.0, elastic=0)}
    assert growth(rows, (1, 8), cells, {"left": "roller", "right": "roller"}) > 1e-3


def test_a_long_flat_body_grows_without_elastic_cells():
    """Far from its corners it is one open side under a free surface."""
    assert growth(soil(0.25), (20, 1), layers(["left", "bottom"])) > 1e-3
    with_elastic = layers(["left", "bottom"], count=3, elastic=1)
    assert growth(soil(0.25), (20, 1), with_elastic) < NONE


# -- allowed ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("poisson", [0.0, 0.25, 0.41, 0.49])
@pytest.mark.parametrize("count, elastic", [(2, 0), (3, 0), (5, 0), (3, 1), (2, 2)])
def test_two_adjacent_sides_do_not_grow(poisson, count, elastic):
    cells = layers(["left", "bottom"], poisson, count=count, elastic=elastic)
    for walls in ({}, {"right": "fixed"}, {"right": "fixed", "top": "shear"}):
        assert growth(soil(poisson), (3, 3), cells, walls) < NONE


@pytest.mark.parametrize("poisson", [0.0, 0.25, 0.41, 0.49])
def test_left_right_and_bottom_under_a_free_surface_do_not_grow(poisson):
    """Whole, and half with a plane of symmetry."""
    half = layers(["left", "bottom"], poisson)
    assert growth(soil(poisson), (3, 4), half, {"right": "roller"}) < NONE
    assert growth(soil(poisson), (2, 2), layers(["left", "right", "bottom"], poisson)) < NONE


@pytest.mark.parametrize("poisson", [0.0, 0.25, 0.41, 0.49])
def test_all_four_sides_do_not_grow(poisson):
    """A quarter with its two planes of symmetry, which give symmetric motions only, and whole."""
    cells = layers(["left", "bottom"], poisson)
    assert growth(soil(poisson), (2, 2), cells, {"right": "roller", "top": "roller"}) < NONE
    whole = layers(["left", "right", "bottom", "top"], poisson, count=2, elastic=0)
    assert growth(soil(poisson), (2, 2), whole) < NONE


@pytest.mark.parametrize("poisson", [0.25, 0.41])
@pytest.mark.parametrize("size", [(1.0, 2.0), (2.0, 1.0), (1.0, 4.0)])
def test_cells_that_are_longer_one_way_do_not_grow(poisson, size):
    """Left, right and bottom; the layers' cells take h of their own direction."""
    sides = {
        side: default_cells(soil(poisson), h, elastic=1)
        for side, h in zip(("left", "bottom"), size, strict=True)
    }
    assert growth(soil(poisson), (3, 3), sides, {"right": "roller"}, size) < NONE


@pytest.mark.parametrize("poisson", [0.0, 0.25, 0.41, 0.49])
@pytest.mark.parametrize("sides", ["roller", "shear"])
def test_a_column_one_cell_wide_does_not_grow(poisson, sides):
    """Its sides leave P or S waves alone; two cells wide it grows."""
    for elastic in (0, 4):
        cells = layers(["bottom"], poisson, count=3, elastic=elastic)
        held = {"left": sides, "right": sides}
        assert growth(soil(poisson), (1, 8), cells, held) < NONE
    assert growth(soil(0.41), (2, 10), layers(["bottom"], 0.41), held) > 1e-3


@pytest.mark.parametrize("top, base", [(0.25, 0.25), (0.0, 0.3), (0.3, 0.49)])
def test_strata_that_differ_little_do_not_grow(top, base):
    """The default layer: stiffer ones above by 1.5 in c_s, softer ones above by 4."""
    assert strata(top, base, 1 / 1.5**2) < NONE
    assert strata(top, base, 4.0**2) < NONE


# -- three dimensions ------------------------------------------------------------------------------


@pytest.mark.parametrize("poisson", [0.25, 0.45])
def test_in_3d_three_sides_that_meet_do_not_grow(poisson):
    three = layers(["left", "bottom", "front"], poisson, count=2, elastic=0)
    assert growth(soil(poisson), (1, 1, 1), three) < NONE


def test_in_3d_two_sides_are_not_enough():
    """Between the other two the grid is a guide."""
    two = layers(["left", "bottom"], 0.45, count=2, elastic=0)
    assert growth(soil(0.45), (2, 2, 2), two) > 1e-3


def test_one_absorbing_cell_is_too_few_in_3d():
    one = layers(["left", "bottom", "front"], 0.41, count=1, elastic=0)
    assert growth(soil(0.41), (1, 1, 1), one) > 1e-3


def test_plane_strain_in_one_layer_of_bricks_does_not_grow():
    cells = layers(["left", "bottom"], count=2, elastic=0)
    walls = {"front": "roller", "back": "roller"}
    assert growth(soil(0.25), (3, 3, 1), cells, walls) < NONE


# -- the function itself ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "poisson, sides, walls, value",
    [
        (0.25, ["bottom"], dict(left="roller", right="roller"), 2.5e-2),
        (0.25, ["bottom"], dict(left="fixed", right="fixed"), 2.0e-2),
        (0.25, ["left", "right"], dict(bottom="fixed"), 5.1e-2),
        (0.41, ["bottom"], dict(left="fixed", right="fixed"), 5.3e-2),
        (0.41, ["left", "right"], dict(bottom="fixed"), 8.3e-2),
    ],
)
def test_growth_found_by_others(poisson, sides, walls, value):
    """By filters of each cell and the QZ algorithm, of bodies of 4 × 4 cells."""
    found = growth(soil(poisson), (4, 4), layers(sides, poisson), walls)
    assert float(f"{found:.1e}") == value


def test_a_step_of_the_trapezoidal_rule_grows_at_that_rate():
    """In time, by a random start: |z| of p is |(1 + pΔt/2)/(1 − pΔt/2)|."""
    arguments = (soil(0.25), (3, 3), layers(["left", "right"]), {"bottom": "fixed"})
    E, A = (matrix.toarray() for matrix in system(*arguments))
    Δt = 0.05
    step = np.linalg.solve(E - Δt / 2 * A, E + Δt / 2 * A)
    steps = 1 << 16
    many = np.linalg.matrix_power(step, steps)
    x = many @ np.random.default_rng(1).standard_normal(len(E))
    x /= np.linalg.norm(x)
    rate = np.log(np.linalg.norm(many @ x)) / (steps * Δt)
    assert rate == pytest.approx(growth(*arguments), rel=0.01)


def test_a_body_without_layers_neither_grows_nor_decays():
    for walls in ({}, {"bottom": "fixed"}, {"left": "roller", "bottom": "shear"}):
        assert abs(growth(soil(0.3), (4, 3), {}, walls)) < 1e-11


def test_a_column_has_the_periods_of_its_cells():
    """ω = (2c/h) sin(kh/2)/√(1 − ⅔ sin²(kh/2)), k = (2n − 1)π/(2H), of bilinear cells."""
    material, n = soil(0.3), 5
    walls = {"left": "roller", "right": "roller", "bottom": "fixed"}
    E, A = (m.toarray() for m in system(material, (1, n), {}, walls))
    frequencies = np.linalg.eigvals(np.linalg.solve(E, A)).imag
    half = (2 * np.arange(1, n + 1) - 1) * np.pi / (4 * n)
    exact = 2 * np.sin(half) / np.sqrt(1 - 2 / 3 * np.sin(half) ** 2)
    exact *= material.p_speed / material.s_speed
    assert abs(frequencies[:, None] - exact).min(axis=0).max() < 1e-10


def test_units_do_not_matter():
    """Of the soil, of the grid."""
    hard = LinearElastic(young=2e8, poisson=0.25, density=2000.0)
    cells = dict.fromkeys(["left", "right"], default_cells(hard, 0.5, elastic=0))
    found = growth(hard, (4, 4), cells, {"bottom": "fixed"}, size=0.5)
    here = growth(soil(0.25), (4, 4), layers(["left", "right"]), {"bottom": "fixed"})
    assert found == pytest.approx(here, rel=1e-9)


@pytest.mark.parametrize(
    "sides, walls, words",
    [
        ({"up": ()}, {}, "side must be one of left, right, bottom, top, got 'up'"),
        ({}, {"left": "glued"}, "wall must be one of fixed, roller, shear, got 'glued'"),
        ({"left": ((1.0, 0.0),)}, {"left": "fixed"}, "left must have a layer or a wall"),
        ({"left": ((1.0, 2.0),)}, {}, "either κ or β above 0, got 1"),
    ],
)
def test_what_cannot_be_is_refused(sides, walls, words):
    with pytest.raises(ValueError, match=words):
        growth(soil(0.25), (2, 2), sides, walls)
