"""Points that go on with an acceleration which fits the stress they bear, not the one that the
matrix foresees."""

import sys
from dataclasses import replace
from pathlib import Path

import dense
import inside
import numpy as np
import pytest
from dense import SOFT, SOIL

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import amplification_map

OFF, LUMPED, IMPLICIT = (mpm.AccelerationCorrection[name] for name in ("OFF", "LUMPED", "IMPLICIT"))
CORRECTED = pytest.mark.parametrize("correction", [LUMPED, IMPLICIT], ids=lambda kind: kind.value)
DIMS = pytest.mark.parametrize("dim", [2, 3], ids=["2D", "3D"])
FACTOR = mpm.Solver(petsc={"ksp_type": "preonly", "pc_type": "lu"})
RUBBER = mpm.Hencky(SOIL.young, SOIL.poisson, SOIL.density)


def free(dim, mapping, stepping=None, correction=OFF, law=SOIL, transfer=mpm.trapezoidal):
    """A body of random stress and motion on a grid with room; steps of 1 ms unless told."""
    grid, stepping = dense.uneven(dim), stepping or mpm.Newmark(1e-3)
    body = dense.random_body(grid, np.random.default_rng(1), lambda x: x[0] < 0.8, law)
    mapping = replace(
        mapping, sweeps=1, transfer=transfer, correction=correction, hold_cut_cells=False
    )
    return mpm.Simulation(grid, body, stepping, [], mapping, FACTOR)


@DIMS
@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM, mpm.DM_G, mpm.DM_C, mpm.DM_GC], ids=str)
@pytest.mark.parametrize(
    "stepping",
    [mpm.Newmark(1e-3), mpm.GeneralizedAlpha(1e-3, 0.7)],
    ids=["Newmark", "generalised α"],
)
def test_the_correction_is_what_the_force_lacks_over_the_lumped_mass(dim, mapping, stepping):
    """Of two runs of a step from the same points: M̄ δa = -(ΔF - K u), by hand, and points take it
    all."""
    plain, balanced = free(dim, mapping, stepping), free(dim, mapping, stepping, correction=LUMPED)
    for run in (plain, balanced):
        run.step()
    before = dense.random_body(plain.grid, np.random.default_rng(1), lambda x: x[0] < 0.8)
    (S, slope), (body,) = inside.shape_functions(plain), plain.bodies
    mass = S.T @ before.mass[:, None]
    change = tensors.matrix(body.stress - before.stress, dim)
    ΔF = np.einsum("p,pij,pkj->ki", before.volume, change, slope)
    lack = inside.foreseen_force(plain) - ΔF
    lack = np.divide(lack, mass, out=np.zeros_like(ΔF), where=mass > 0) / stepping.inertia
    for name, by in (("acceleration", 1.0), ("velocity", stepping.gamma * stepping.dt)):
        found = getattr(balanced.bodies[0], name) - getattr(body, name)
        np.testing.assert_allclose(found, by * S @ lack, rtol=0, atol=1e-9 * np.abs(found).max())
        assert np.abs(found).max() > 0.0
    assert np.array_equal(balanced.bodies[0].x, body.x)


@DIMS
@pytest.mark.parametrize("law", [SOIL, RUBBER], ids=["small strain", "Hencky"])
@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM_G, mpm.DM_GC], ids=str)
@pytest.mark.parametrize(
    "stepping",
    [mpm.Newmark(1e-3), mpm.GeneralizedAlpha(1e-3, 0.7)],
    ids=["Newmark", "generalised α"],
)
def test_the_implicit_correction_solves_with_the_matrix_of_the_step(dim, mapping, law, stepping):
    """A δa = -(ΔF - K u) / (β Δt²) with the matrix A of the step, both by hand; at finite strain ΔF
    is that of J σ f⁻ᵀ against gradients before the step, and K u what the nominal stress of the
    grid gives."""
    plain, corrected = (free(dim, mapping, stepping, kind, law) for kind in (OFF, IMPLICIT))
    before = dense.random_body(plain.grid, np.random.default_rng(1), lambda x: x[0] < 0.8)
    for run in (plain, corrected):
        run.step()
    (S, slope), (body,) = inside.shape_functions(plain), plain.bodies
    after = tensors.matrix(body.stress, dim)
    if law is RUBBER:
        f = np.eye(dim) + inside.recovered_gradient(plain, before.x)
        after = np.linalg.det(f)[:, None, None] * after @ np.linalg.inv(f).transpose(0, 2, 1)
    change = tensors.matrix(before.stress, dim) - after
    lack = np.einsum("p,pij,pkj->ki", before.volume, change, slope)
    lack += inside.foreseen_force(plain)
    found = inside.equations(plain)
    used = ~found.idle
    A = found.matrix[np.ix_(used, used)]
    change = np.zeros(lack.size)
    change[used] = np.linalg.solve(A, lack.ravel()[used]) / (stepping.beta * stepping.dt**2)
    for name, by in (("acceleration", 1.0), ("velocity", stepping.gamma * stepping.dt)):
        found = getattr(corrected.bodies[0], name) - getattr(body, name)
        expected = by * S @ change.reshape(-1, dim)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.abs(expected).max())
    assert np.array_equal(corrected.bodies[0].x, body.x)


@DIMS
@CORRECTED
@pytest.mark.parametrize("transfer", [mpm.trapezoidal, mpm.flip])
@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM_G, mpm.DM_GC], ids=str)
def test_momentum_of_a_free_body_stays(dim, mapping, transfer, correction):
    """Neither force has a sum: Σ m Δv = ½ Δt Σ m a, a those at the start; FLIP: Σ m Δv = ½ Δt (Σ m
    a) as well."""
    run = free(dim, mapping, transfer=transfer, correction=correction)
    body = run.bodies[0]
    wanted = body.mass @ (body.velocity + 5e-4 * body.acceleration)
    run.step()
    np.testing.assert_allclose(
        body.mass @ body.velocity,
        wanted,
        rtol=0,
        atol=1e-11 * (body.mass @ np.abs(body.velocity)).max(),
    )


@CORRECTED
def test_where_the_matrix_is_the_derivative_there_is_nothing_to_correct(correction):
    """Plain MPM's is, and so none is chosen for it."""
    plain, balanced = free(2, mpm.MPM), free(2, mpm.MPM, correction=correction)
    assert free(2, mpm.MPM, correction=None).correction is None
    for run in (plain, balanced):
        run.step()
    for name in ("velocity", "acceleration", "stress"):
        value = getattr(plain.bodies[0], name)
        np.testing.assert_allclose(
            getattr(balanced.bodies[0], name), value, rtol=0, atol=1e-10 * np.abs(value).max()
        )


def standing(poisson, courant, correction):
    """Part of its energy that a standing shear wave of 20 cells a length loses in some steps, with
    DM-GC."""
    soil, n = mpm.LinearElastic(20e6, poisson, 1500.0), 10
    grid = mpm.Grid.box((0, 0), (1, 1), (n, n))
    walls = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom", "top"), "y"),
    ]
    body = mpm.MaterialPoints.fill(grid, soil, 4)
    stepping = mpm.Newmark(courant / n / soil.s_speed)
    run = mpm.Simulation(
        grid, body, stepping, walls, replace(mpm.DM_GC, sweeps=1, correction=correction)
    )
    c, s = (f(np.pi * body.x.T) for f in (np.cos, np.sin))
    body.velocity[:] = 1e-6 * soil.s_speed * np.stack((s[0] * c[1], -c[0] * s[1]), axis=1)
    energy = run.record(mpm.Energy())
    run.until(100 * run.stepping.dt)
    return 1.0 - energy.left[-1] / energy.left[0]


@CORRECTED
@pytest.mark.parametrize(
    "poisson, courant, least",
    [(0.25, 0.5, 0.05), (0.41, 0.5, 0.1), (0.48, 0.5, 0.3), (0.41, 0.25, 0.025)],
)
def test_a_shear_wave_keeps_the_energy_that_locking_of_the_matrix_took(
    poisson, courant, least, correction
):
    """Of what it lost in 100 steps at least three quarters; Courant numbers are those of shear
    waves."""
    plain, balanced = (standing(poisson, courant, kind) for kind in (OFF, correction))
    assert plain > least
    assert abs(balanced) < plain / 4


@CORRECTED
@pytest.mark.parametrize(
    "mapping, courant",
    [(mpm.DM_GC, 0.5), (mpm.DM_GC, 2.0), (mpm.DM_G, 0.5), (mpm.DM_G, 5.0)],
    ids=str,
)
def test_no_mode_of_a_free_bar_grows(mapping, courant, correction):
    """Neither on nor off the grid lines; those of DM-GC did, by up to 7e-5 a step, and do by up to
    4e-5."""

    def fastest(correction):
        way, step = replace(mapping, correction=correction), amplification_map.step_of(courant)
        runs = (amplification_map.bar(way, step, offset=at) for at in (0.0, 0.3))
        return max(
            np.abs(np.linalg.eigvals(amplification_map.StepMap(run).matrix)).max() for run in runs
        )

    grows = (mapping, courant) == (mpm.DM_GC, 0.5)
    assert fastest(correction) < 1.0 + ((1e-5 if correction is LUMPED else 5e-5) if grows else 1e-6)
    if mapping is mpm.DM_GC:
        assert fastest(OFF) > 1.0 + 2e-5


@CORRECTED
def test_soil_that_does_not_yield_is_elastic_and_soil_that_does_is_corrected_too(correction):
    def pulled(law, b_bar=None):
        grid = mpm.Grid.box((0, 0), (4, 4), (4, 4))
        body = mpm.MaterialPoints.fill(grid, law, 4, inside=lambda x: (x[0] > 1) & (x[1] > 1))
        body.velocity = 0.2 * np.stack((body.x[:, 0] - 2.5, 2.5 - body.x[:, 1]), axis=1)
        dashpots = mpm.ViscousBoundary(body.surface("left"), SOFT)
        mapping = replace(mpm.DM_GC, correction=correction, b_bar=b_bar)
        run = mpm.Simulation(grid, body, mpm.Newmark(5e-3), dashpots, mapping)
        run.until(0.05)
        return body

    strong, elastic = (
        pulled(mpm.VonMises(SOFT, peak=1e9, residual=1e9, softening=0.0)),
        pulled(SOFT, b_bar=True),
    )
    np.testing.assert_allclose(
        strong.stress, elastic.stress, rtol=0, atol=1e-9 * np.abs(elastic.stress).max()
    )
    weak = pulled(mpm.VonMises(SOFT, peak=1e4, residual=5e3, softening=1e4))
    assert weak.history.max() > 0.0
    assert np.isfinite(weak.velocity).all()


def test_a_run_without_it_does_not_pay_for_it_and_what_cannot_have_it_is_refused():
    assert free(2, mpm.DM_GC).correction is None
    short, long = (
        free(2, mpm.DM_GC, mpm.Newmark(dt), correction=None).correction_kind for dt in (1e-5, 1.0)
    )
    assert short is LUMPED and long is IMPLICIT
    assert free(2, mpm.DM_GC, mpm.QuasiStatic(2), correction=None).correction is None
    with pytest.raises(ValueError, match="correction is of accelerations"):
        free(2, mpm.DM_GC, mpm.QuasiStatic(2), correction=LUMPED)
