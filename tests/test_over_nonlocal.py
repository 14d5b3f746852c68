"""Softening with a length of its own: the law at a point, the average on the grid, and the band of
a sheared layer against its exact solution."""

import json
from dataclasses import replace

import numpy as np
import pytest
import softening
from laws import plastic_strain, random_states, tangent_errors
from plastic import ELASTIC
from softening import CLAY, HEIGHT, LENGTH, SOFTENING, Layer, band_of, exact_band
from test_ranks import difference, on_ranks

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical import shear_band
from mpm_fenicsx.common import tensors

SQRT3 = np.sqrt(3.0)
LAW = mpm.VonMises(ELASTIC, 10e3, 4e3, 200e3, averaging=mpm.OverNonlocal(0.2, 3.0))

# -- the law at a point ----------------------------------------------------------------------------


def states(count, n=2000):
    strain, stress, history = random_states(LAW, count, n, kappa=0.02)
    history[:, 2] = np.random.default_rng(1).uniform(0.0, 0.03, n)
    return strain, stress, history


@pytest.mark.parametrize("count", [4, 6])
def test_strength_goes_by_what_is_averaged(count):
    """m κ̄ + (1 - m) κ in place of κ, κ̄ as it was; plastic work is σ_after : Δεᵖ."""
    strain, stress, history = states(count)
    new, after, _ = LAW.tangent(strain, stress, history)
    np.testing.assert_array_equal(after[:, 2], history[:, 2])
    flows = after[:, 0] > history[:, 0]
    assert 0.3 < flows.mean() < 1.0
    follows = 3.0 * after[:, 2] - 2.0 * after[:, 0]
    c = np.maximum(4e3, 10e3 - 200e3 * follows)
    q = tensors.von_mises(new)
    np.testing.assert_allclose(q[flows], SQRT3 * c[flows], rtol=1e-11)
    assert (q <= SQRT3 * c * (1 + 1e-11)).all()
    εp = plastic_strain(LAW, strain, stress, new)
    work = (new * εp).sum(axis=1)
    np.testing.assert_allclose(after[:, 1] - history[:, 1], work, atol=1e-9 * work.max())
    np.testing.assert_array_equal(LAW.plastic_work(after), after[:, 1])
    np.testing.assert_allclose(LAW.strength(after), SQRT3 * c, rtol=1e-12)
    np.testing.assert_array_equal(
        LAW.yields(strain, stress, history, *[np.arange(len(strain), dtype=np.int32)] * 2),
        np.flatnonzero(flows),
    )


@pytest.mark.parametrize("count", [4, 6])
def test_the_tangent_is_the_derivative_at_a_given_average(count):
    error = tangent_errors(LAW, *states(count))
    assert np.median(error) < 1e-8
    assert error.max() < 1e-6


def test_a_point_of_its_own_strength_softens_from_there():
    strain, stress, history = states(4, 100)
    given = {"peak": np.full(100, 7e3), "residual": np.full(100, 1e3)}
    own = replace(LAW, peak=7e3, residual=1e3)
    for mine, its in zip(
        LAW.tangent(strain, stress, history, given),
        own.tangent(strain, stress, history),
        strict=True,
    ):
        np.testing.assert_array_equal(mine, its)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mpm.OverNonlocal(0.0), r"length must be positive, got 0\.0"),
        (lambda: mpm.OverNonlocal(0.1, 1.0), r"weight must be above 1: .* single cell, got 1\.0"),
        (lambda: mpm.OverNonlocal(0.1, 0.5), r"weight must be above 1: .* got 0\.5"),
        (lambda: mpm.OverNonlocal(0.1, np.nan), "weight must be finite, got nan"),
        (lambda: replace(LAW, length=0.1), r"length must be None with averaging, .* got 0\.1"),
        (lambda: replace(LAW, averaging=0.2), r"averaging must be an OverNonlocal.*, got 0\.2"),
    ],
)
def test_refusals(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_law_of_ones_own_must_have_the_state_variables():
    class Own(mpm.OnElastic):
        elastic, averaging = ELASTIC, mpm.OverNonlocal(0.5)
        history = ("plastic_work", "nonlocal_strain")
        parameters = ()

        def tangent(self, strain, stress, history, given=None):
            return ELASTIC.tangent(strain, stress, history)

    grid = mpm.Grid.box((0, 0), (1, 1), (4, 4))
    with pytest.raises(ValueError, match=r"averaging needs the state .* lacks plastic_strain"):
        mpm.Simulation(
            grid, mpm.MaterialPoints.fill(grid, Own(), 4), mpm.Newmark(1e-3), [], mpm.DM_GC
        )


# -- the exact answer, once more -------------------------------------------------------------------


@pytest.mark.parametrize("weight", [1.5, 2.0, 3.0])
def test_the_band_solves_its_equations_on_a_line_of_differences(weight):
    """κ >= 0, s - m κ̄ + (m - 1) κ >= 0, one of both zero, κ̄ - l² κ̄'' = κ by central differences on
    40 l: the widest band for which all holds is that of the closed form."""
    length, s = 1.0, 1.0
    x, h = np.linspace(-20, 20, 8001, retstep=True)
    n = len(x)
    K = np.zeros((3, n))  # a banded matrix
    K[1] = 1.0 + 2.0 * length**2 / h**2
    K[1, [0, -1]] -= length**2 / h**2
    K[0, 1:] = K[2, :-1] = -(length**2) / h**2
    from scipy.linalg import solve_banded

    def of_half_width(a):
        """κ̄ and κ where the middle 2 a flow: κ = (m κ̄ - s)/(m - 1) there."""
        flows, B = np.abs(x) < a, K.copy()
        B[1, flows] -= weight / (weight - 1.0)
        average = solve_banded((1, 1), B, np.where(flows, -s / (weight - 1.0), 0.0))
        return average, np.where(flows, (weight * average - s) / (weight - 1.0), 0.0)

    guess = shear_band.half_width(length, weight)
    near = guess + h * np.arange(-40, 40)
    right = []
    for a in near:
        average, kappa = of_half_width(a)
        rest = s - weight * average + (weight - 1.0) * kappa
        if kappa.min() >= -1e-9 and rest.min() >= -1e-9:
            right.append(a)
    assert len(right) > 0
    assert np.abs(np.array(right) - guess).max() < 2.0 * h
    average, kappa = of_half_width(right[0])
    np.testing.assert_allclose(
        kappa, shear_band.plastic_strain(x, s, length, weight), atol=8 * h * kappa.max()
    )
    np.testing.assert_allclose(
        average, shear_band.nonlocal_strain(x, s, length, weight), atol=2 * h * average.max()
    )
    wide = kappa.sum() * h / s
    assert wide == pytest.approx(shear_band.softening_width(length, weight), rel=2e-3)


def test_the_numbers_of_weight_two():
    assert shear_band.width(1.0) == pytest.approx(1.5 * np.pi)
    assert shear_band.softening_width(1.0) == pytest.approx(1.5 * np.pi + 2.0)


# -- the average on the grid -----------------------------------------------------------------------


def averaged(grid, bodies, kappa):
    """κ̄ of points (or, for None, of finite elements) of a plastic strain ``kappa`` of x (n, dim),
    after a step in which nothing moves."""
    if bodies is None:
        run = mpm.FiniteElements(grid, LAW, mpm.QuasiStatic(1), [mpm.Fixed(grid.facets("all"))])
        x, history = run.gauss_places(), run.gauss_history()
        history[:, 0] = kappa(x)
        run.step()
        return x, run.gauss_history()
    for body in bodies:
        body.history = np.zeros((len(body), 3))
        body.history[:, 0] = kappa(body.x)
    terms = [mpm.Fixed(grid.facets("all"))]
    run = mpm.Simulation(grid, bodies, mpm.Newmark(1e-6), terms, mpm.DM_GC)
    run.step()
    return np.concatenate([b.x for b in bodies]), np.concatenate([b.history for b in bodies])


def everywhere(x):
    return np.ones(x.shape[1], bool)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["FE", "points"])
def test_a_wave_is_averaged_as_it_is_exactly(kind, dim):
    """cos(kx) between natural edges has the average cos(kx)/(1 + l²k²), to second order in h."""
    k, exact, errors = np.pi / 2.0, 1.0 / (1.0 + (0.2 * np.pi / 2.0) ** 2), []
    for n in (8, 16) if dim == 2 else (8,):
        cells = (n, 2, 1)[:dim]
        box = (2.0, 0.5, 0.25)[:dim]
        grid = mpm.Grid.box((0.0,) * dim, box, cells, facets={"all": everywhere})
        bodies = None if kind == "FE" else [mpm.MaterialPoints.fill(grid, LAW, 2**dim)]
        x, history = averaged(grid, bodies, lambda x: 0.01 * (1.0 + np.cos(k * x[:, 0])))
        wanted = 0.01 * (1.0 + exact * np.cos(k * x[:, 0]))
        errors.append(np.abs(history[:, 2] - wanted).max() / 0.01)
    assert errors[0] < 0.04
    assert dim == 3 or errors[0] / errors[1] > 3.0


@pytest.mark.parametrize("seed", range(3))
def test_what_is_even_stays_even_wherever_points_are(seed):
    """In cut cells too: cells without material take no part."""
    rng = np.random.default_rng(seed)
    grid = mpm.Grid.box((0.0, 0.0), (2.0, 1.0), (10, 5), facets={"all": everywhere})
    body = mpm.MaterialPoints.fill(
        grid, LAW, 4, lambda x: x[0] + 0.3 * x[1] < 0.7 + 0.8 * rng.random(), jitter=0.4
    )
    _, history = averaged(grid, [body], lambda x: np.full(len(x), 0.01))
    np.testing.assert_allclose(history[:, 2], 0.01, rtol=1e-8)


def test_nothing_is_averaged_over_a_gap_nor_over_materials():
    """Two bodies of one material a cell apart, and one of another material beside them; bodies of
    one material that touch are one."""
    grid = mpm.Grid.box((0.0, 0.0), (2.0, 0.4), (10, 2), facets={"all": everywhere})
    other = replace(LAW, averaging=mpm.OverNonlocal(0.3))

    def body(law, low, high):
        return mpm.MaterialPoints.fill(grid, law, 4, lambda x: (x[0] > low) & (x[0] < high))

    bodies = [
        body(LAW, 0.0, 0.4),
        body(LAW, 0.4, 0.8),
        body(LAW, 1.0, 1.4),
        body(other, 1.4, 2.0),
    ]
    averaged(grid, bodies, lambda x: np.where(x[:, 0] < 0.4, 0.01, 0.0))
    one, touching, apart, strange = (body.history[:, 2] for body in bodies)
    assert one.min() > 0.0 and touching.min() > 1e-4
    assert one.max() < 0.01
    assert max(apart.max(), strange.max()) < 1e-12


def test_who_does_not_soften_over_a_length_has_nothing_of_it():
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (4, 4))
    local = replace(LAW, averaging=None)
    for law, says in ((local, False), (LAW, True)):
        with pytest.warns(UserWarning, match="length of averaging") if says else _nothing():
            points = mpm.Simulation(
                grid, mpm.MaterialPoints.fill(grid, law, 4), mpm.Newmark(1e-3), []
            )
            elements = mpm.FiniteElements(grid, law, mpm.Newmark(1e-3), [])
        for run in (points, elements):
            assert bool(run.averages) is says
            assert ("softening over 0.2 m, weight 3" in str(run)) is says


def _nothing():
    import contextlib

    return contextlib.nullcontext()


def test_a_length_below_two_cells_is_warned_of():
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (8, 4))
    law = replace(LAW, averaging=mpm.OverNonlocal(0.4))
    message = r"length of averaging is 0\.4 m, and cells are up to 0\.25 m: below two cells"
    with pytest.warns(UserWarning, match=message):
        mpm.FiniteElements(grid, law, mpm.Newmark(1e-3), [])
    with pytest.warns(UserWarning, match=message):
        mpm.Simulation(grid, mpm.MaterialPoints.fill(grid, law, 4), mpm.Newmark(1e-3), [])


# -- the sheared layer -----------------------------------------------------------------------------


@pytest.mark.parametrize("mapping", [None, mpm.DM_GC], ids=str)
def test_a_sheared_layer_fails_in_the_exact_band(mapping):
    """The band that flows is as wide as the exact one to a cell, and softens as one 2 (a + l) wide
    to 0.5 % at l = 5 h: of second order in h, 2.1 h²/l² per cent-cell for finite elements."""
    layer = Layer(mapping)
    before = (0.0, 0.0)
    for _ in range(60):
        kappa = layer.state()[2][:, 0].copy()
        now = layer.step()
        before, last = now, before
    wide = band_of(*zip(last, before, strict=True))
    assert wide == pytest.approx(exact_band(), rel=5e-3)
    y, _, history = layer.state()
    grown = history[:, 0] - kappa
    flows = y[grown > 1e-3 * grown.max()]
    assert abs(np.ptp(flows) - shear_band.width(LENGTH)) <= 0.05
    slope = (before[1] - last[1]) / (before[0] - last[0])
    exact = shear_band.softening_slope(HEIGHT, CLAY.lame[1], SOFTENING, LENGTH)
    assert slope == pytest.approx(exact, rel=0.01)
    # the shape of what grows: that of the exact κ per unit of lost strength
    lost = (last[1] - before[1]) / SOFTENING
    row = np.round(y / 0.05 - 0.5).astype(int) + 40  # means of cells, in which strain is even
    grown = np.bincount(row, grown) / np.bincount(row)
    wanted = shear_band.plastic_strain(0.05 * (np.arange(80) - 39.5), lost, LENGTH)
    assert np.linalg.norm(grown - wanted) < 0.02 * np.linalg.norm(wanted)


def test_the_error_of_the_band_falls_with_the_square_of_the_cell():
    errors = []
    for cell in (0.125, 0.0625):
        layer, last, now = Layer(None, cell=cell, steps=40), (0.0, 0.0), (0.0, 0.0)
        for _ in range(40):
            last, now = now, layer.step()
        errors.append(band_of(*zip(last, now, strict=True)) / exact_band() - 1.0)
    assert 3.5 < errors[0] / errors[1] < 4.5


def plastic_work(mapping, cell, steps, **options):
    """Plastic work (J/m) of the pressed block after thirds of its shortening."""
    run, found = softening.biaxial(mapping, cell, steps=steps, **options), []
    for step in range(1, steps + 1):
        run.step()
        if step % (steps // 3) == 0:
            found.append(run.energy()["plastic"])
    return np.array(found)


def test_a_pressed_block_takes_the_same_work_on_two_grids():
    coarse, fine = (plastic_work(None, cell, 18) for cell in (0.1, 0.05))
    np.testing.assert_allclose(fine, coarse, rtol=5e-3)
    local = replace(softening.PRESSED, averaging=None)
    assert plastic_work(None, 0.1, 18, law=local)[-1] < 0.75 * coarse[-1]  # one cell takes less


ELASTIC_BLOCK = softening.PRESSED.elastic
FALLS = mpm.Curve([0.0, 15e3 / 4e6], [20e3, 5e3])


@pytest.mark.parametrize(
    "law",
    [
        mpm.MohrCoulomb(ELASTIC_BLOCK, FALLS, 20.0, averaging=softening.PRESSED.averaging),
        mpm.Undrained(softening.PRESSED, bulk_modulus=1e9),
    ],
    ids=["MohrCoulomb", "Undrained"],
)
def test_other_laws_take_the_same_work_on_two_grids(law):
    coarse, fine = (plastic_work(None, cell, 12, law=law) for cell in (0.1, 0.0625))
    assert softening_of(coarse) < 0.95  # or grids would agree because nothing softens
    # once it softens; until then the corners' elastic singularities are told apart
    np.testing.assert_allclose(fine[1:], coarse[1:], rtol=1e-2)


def softening_of(work):
    """What the last third of a shortening takes, per what the second takes."""
    return (work[2] - work[1]) / (work[1] - work[0])


def history_after(layer, steps):
    for _ in range(steps):
        layer.step()
    return layer.state()[2]


COARSE = {"cell": 0.125, "steps": 40, "solver": softening.DIRECT}


def test_in_space_the_layer_is_the_same():
    flat = Layer(mpm.DM_GC, **COARSE)
    solid = Layer(mpm.DM_GC, dim=3, **COARSE)
    history_after(flat, 16), history_after(solid, 16)
    (y, _, a), (z, _, b) = flat.state(), solid.state()
    a, b = (h[np.lexsort((h[:, 0], np.round(x, 6)))] for x, h in ((y, a), (z, b)))
    np.testing.assert_allclose(np.repeat(a, 2, axis=0), b, atol=1e-6 * a[:, 0].max())
    assert a[:, 2].max() > 1e-5


@pytest.mark.parametrize("mapping", [None, mpm.DM_GC], ids=str)
def test_at_finite_strain_a_layer_that_strains_little_is_the_same(mapping):
    law = replace(CLAY, elastic=mpm.Hencky(75e6, 0.25, 1800.0))
    small, finite = (history_after(Layer(mapping, law=one, **COARSE), 16) for one in (CLAY, law))
    assert small[:, 0].max() > 2.5e-4
    assert np.abs(small - finite)[:, [0, 2]].max() < 1e-2 * small[:, 0].max()


# -- state -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", ["FE", "DM-GC", "Hencky"])
def test_a_run_that_goes_on_is_the_same_to_the_last_bit(case, tmp_path):
    straight = softening.CASES[case]()
    straight.record(mpm.Checkpoint(tmp_path / "half", every=4))
    for _ in range(4):
        straight.step()
    again = softening.CASES[case]()
    again.restart(next(iter(sorted(tmp_path.glob("half*")))))
    for run in (straight, again):
        for _ in range(4):
            run.step()
    a, b = (softening.columns(run) for run in (straight, again))
    assert a == b
    assert max(row[2] for row in a.values()) > 1e-5


def test_finite_elements_go_on_from_another_run():
    first = Layer(None, **COARSE)
    history_after(first, 12)
    second = mpm.FiniteElements(
        first.grid,
        CLAY,
        mpm.QuasiStatic(4),
        [mpm.Fixed(first.grid.facets("bottom", "top"))],
        start=first.run,
    )
    assert second.gauss_history()[:, 2].max() > 0.0
    np.testing.assert_array_equal(second.gauss_history(), first.run.gauss_history())


def test_the_energy_balances():
    """Plastic work is summed by the algorithm's own rule: what the top's work leaves over strain
    energy and plastic work, backward Euler dissipates, of first order in the step."""
    lost = []
    for steps in (40, 80):
        layer = Layer(None, cell=0.125, steps=steps)
        start, work, last = sum(layer.run.energy().values()), 0.0, (0.0, 0.0)
        for _ in range(steps):
            now = layer.step()
            work += 0.5 * (last[1] + now[1]) * (now[0] - last[0]) * 2 * 0.125
            last = now
        assert layer.run.energy()["plastic"] > 0.5 * work
        lost.append(1.0 - (sum(layer.run.energy().values()) - start) / work)
    assert 0.0 < lost[0] < 0.02
    assert lost[1] < 0.7 * lost[0]


@pytest.fixture(scope="module")
def serial():
    return softening.everything()


@pytest.mark.ranks
@pytest.mark.parametrize("count", [2, 3])
def test_ranks_find_what_one_does(serial, count, tmp_path):
    out = tmp_path / "out.json"
    on_ranks(count, softening.__file__, out)
    several = json.loads(out.read_text())
    for case, rows in serial.items():
        assert max(row[2] for row in rows.values()) > 1e-4
        assert difference(several[case], rows) < 1e-7, case
