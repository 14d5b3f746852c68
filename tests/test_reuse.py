"""Cells whose density and moduli have hardly changed are not assembled anew: bound, matrix, cost,
refusals."""

import inside
import numpy as np
import pytest
import scipy.linalg
from dense import SOFT, SOIL

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions
from mpm_fenicsx.mapping.lagged_properties import at_quadrature
from mpm_fenicsx.mapping.projection import AT_POINTS, DOUBLE_MAPPED

pytestmark = pytest.mark.skipif(
    not dolfinx_versions.FORMS_FOLLOW, reason="forms of DOLFINx 0.5 go over all cells"
)


def slide(dim, mapping, reuse, speed=3.0, size=6, extra=()):
    """A block on dashpots, pressed from above, slides sideways and down by a tenth of a cell a
    step."""
    low, high = np.array((-1.0, -2.0, 0.0))[:dim], np.array((size + 4.0, size + 1.0, 2.0))[:dim]
    grid = mpm.Grid.box(low, high, (high - low).astype(int))
    body = mpm.MaterialPoints.fill(
        grid, SOFT, 2**dim, inside=lambda x: ((x[:2] > 0) & (x[:2] < size)).all(axis=0)
    )
    body.velocity = np.tile((speed, -speed / 3, 0.0)[:dim], (len(body), 1))
    terms = [
        mpm.ViscousBoundary(body.surface("bottom"), SOFT),
        mpm.Traction(body.surface("top"), (0.0, -2e4, 0.0)[:dim]),
        *extra,
    ]
    return mpm.Simulation(
        grid, body, mpm.Newmark(0.1 / 3.0), terms, mapping, mpm.Solver(reuse=reuse)
    )


@pytest.mark.parametrize(
    "dim, mapping, steps",
    [
        (2, mpm.DM_GC, 60),
        (2, mpm.GIMP, 40),
        (3, mpm.DM_GC, 15),
    ],
    ids=str,
)
def test_the_matrix_is_that_of_the_kept_fields_while_a_body_crosses_cells(dim, mapping, steps):
    """To round-off of what cells have held before they ran empty, entry by entry beside its
    diagonal."""
    run = slide(dim, mapping, 3e-2, speed=1.0, size=12 if dim == 2 else 3)
    parts = anew = 0
    for _ in range(steps):
        run.step()
        found, wanted = inside.kept_matrix(run)
        idle = inside.equations(run).idle
        used = ~(idle | np.repeat(inside.tied(run), dim))
        assert used.any() and (np.diag(wanted)[idle] <= 1e-20 * np.diag(wanted).max()).all()
        size = np.sqrt(np.diag(wanted)[used])
        difference = np.abs(found - wanted)[np.ix_(used, used)] / np.outer(size, size)
        assert difference.max() < 1e-6
        changed, full = inside.assembled(run)
        few = changed < full
        parts, anew = parts + few, anew + (not few)
    assert parts > anew


@pytest.mark.parametrize(
    "dim, mapping, limit",
    [
        (2, mpm.DM_GC, 1e-3),
        (2, mpm.DM_GC, 3e-2),
        (2, mpm.DM_G, 3e-2),
        (2, mpm.GIMP, 3e-2),
        (3, mpm.DM_GC, 3e-2),
    ],
    ids=str,
)
def test_the_kept_matrix_bounds_the_true_one(dim, mapping, limit):
    """(1 - limit) x·A'x <= x·Ax <= (1 + limit) x·A'x for all x."""
    size = 5 if dim == 2 else 3
    run, differed = slide(dim, mapping, limit, size=size), 0.0
    for _ in range(6):
        run.step()
        run.prepare(run.time, run.next_time)
        run.predict()
        lagged = inside.equations(run, assemble=True)
        true = slide(dim, mapping, 0.0, size=size)
        for name, value in true.state().items():
            if name.startswith(("bodies/", "surfaces/")):
                value[...] = run.state()[name]
        true.prepare(run.time, run.next_time)
        exact = inside.equations(true, assemble=True)
        used = ~(lagged.idle | exact.idle)
        kept, exact_one = (found.matrix[np.ix_(used, used)] for found in (lagged, exact))
        scale = 1.0 / np.sqrt(np.diag(exact_one))
        kept, exact_one = (scale[:, None] * A * scale for A in (kept, exact_one))
        ratio = scipy.linalg.eigh(exact_one, kept, eigvals_only=True)
        assert 1.0 - limit - 1e-9 <= ratio.min() and ratio.max() <= 1.0 + limit + 1e-9
        differed = max(differed, np.abs(ratio - 1.0).max())
    assert differed > limit / 30  # it is not the true one


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("integration", [AT_POINTS, DOUBLE_MAPPED], ids=str)
def test_samples_are_values_at_gauss_points(dim, integration):
    """Those of x^α for every α that the space holds."""
    n, rng = integration.degree + 1, np.random.default_rng(3)
    sample = at_quadrature(integration, dim)
    gauss = np.polynomial.legendre.leggauss((integration.quadrature + 1) // 2)
    place, nodes = 0.5 * (1.0 + gauss[0]), np.linspace(0.0, 1.0, n)
    factor = rng.normal(size=(dim, n))

    def field(line):
        values = [np.polynomial.polynomial.polyval(line, factor[d]) for d in range(dim)]
        return np.prod(np.meshgrid(*values, indexing="ij"), axis=0).ravel(order="F")

    np.testing.assert_allclose(sample @ field(nodes), field(place), rtol=0, atol=1e-13)


def test_a_pulse_in_a_column_differs_by_less_than_the_limit():
    """As the error of the matrix does not add up over 150 steps."""
    found = []
    for reuse in (0.0, 1e-3):
        grid = mpm.Grid.box((0, -1), (0.5, 11), (2, 48))
        body = mpm.MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: (x[1] > 0) & (x[1] < 10))
        terms = [
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.ViscousBoundary(body.surface("bottom"), SOIL),
            mpm.Traction(
                body.surface("top"), lambda t: (0.0, -300.0 * max(0.0, 1.0 - abs(t - 0.05) / 0.05))
            ),
        ]
        run = mpm.Simulation(grid, body, mpm.Newmark(1e-3), terms, solver=mpm.Solver(reuse=reuse))
        run.until(0.15)
        found.append(body.stress[:, 1])
    assert 0.0 < np.abs(found[1] - found[0]).max() < 1e-3 * 300.0


def test_a_body_at_rest_is_assembled_once():
    run = slide(2, mpm.DM_GC, 1e-3, speed=0.0)
    run.terms.clear()
    body = run.bodies[0]
    still = mpm.Simulation(
        run.grid, body, mpm.Newmark(1e-2), [mpm.Gravity((0.0, 0.0))], solver=mpm.Solver(reuse=1e-3)
    )
    for step in range(4):
        still.step()
        changed, full = inside.assembled(still)
        assert changed == (full if step == 0 else 0)


def test_a_run_that_does_not_name_it_does_not_pay_for_it():
    run = slide(2, mpm.DM_GC, 0.0)
    assert inside.assembled(run) is None
    assert not inside.bill(run).fields_kept_apart
    assert not any(name.startswith("properties") for name in run.state())


@pytest.mark.parametrize("reuse", [-1e-3, 0.2, np.nan, np.inf])
def test_limits_out_of_range_are_refused(reuse):
    with pytest.raises(ValueError, match="reuse"):
        mpm.Solver(reuse=reuse)


def test_what_cannot_be_kept_is_refused():
    with pytest.raises(ValueError, match=r"reuse = 0.001 .*GhostPenalty"):
        slide(2, mpm.DM_GC, 1e-3, extra=[mpm.GhostPenalty()])
    grid = mpm.Grid.box((0, 0), (2, 2), (2, 2))
    for law in (
        mpm.Hencky(3e6, 0.3, 1800.0),
        mpm.VonMises(SOFT, peak=3e3, residual=1e3, softening=3e4),
    ):
        with pytest.raises(ValueError, match=r"reuse = 0.001 .*elastic"):
            body = mpm.MaterialPoints.fill(grid, law, 4)
            mpm.Simulation(grid, body, mpm.Newmark(1e-2), [], solver=mpm.Solver(reuse=1e-3))


def test_a_restart_goes_on_with_what_was_kept():
    """To round-off: the matrix is made anew then, and was a sum of changes before."""
    run, again = slide(2, mpm.DM_GC, 1e-2), slide(2, mpm.DM_GC, 1e-2)
    for _ in range(8):
        run.step()
    again.restore({name: value.copy() for name, value in run.state().items()})
    again.steps = run.steps
    for r in (run, again):
        for _ in range(4):
            r.step()
    for name in ("x", "velocity", "stress"):
        value = getattr(run.bodies[0], name)
        np.testing.assert_allclose(
            getattr(again.bodies[0], name), value, rtol=0, atol=1e-8 * np.abs(value).max()
        )
