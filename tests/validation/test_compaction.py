"""A column compacts under its own weight: 4 % of strain at its base, or 70 %; Lambert's W has the answer."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import lambertw

from mpm_fenicsx import (
    CMPM,
    DM,
    DM_C,
    DM_G,
    DM_GC,
    GIMP,
    MPM,
    FiniteElements,
    Fixed,
    Gravity,
    Grid,
    Hencky,
    LinearElastic,
    MaterialPoints,
    QuasiStatic,
    Simulation,
)

pytestmark = pytest.mark.validation

HEIGHT, DENSITY, G, STEPS = 50.0, 80.0, 10.0, 20
CELLS = np.array([10, 20, 40, 80])
SOFT = {1e6: "E = 1 MPa, 4 % strain", 1e4: "E = 10 kPa, 70 % strain"}
LOST = "points that cross cells on linear shape functions lose their stress; it does not fall with h"


def stretch(Y, E):
    """λ = W(s)/s at the place Y (m) in the column at rest: ln λ/λ = -s, s = ρ₀g (l₀ - Y)/E."""
    s = DENSITY * G * (HEIGHT - Y) / E
    return lambertw(s).real / s


def place(Y, E):
    """Where Y has gone: ∫ λ dY, by ∫ W(s)/s ds = W + W²/2."""
    a = DENSITY * G / E
    low, high = (W + W**2 / 2 for W in (lambertw(a * (HEIGHT - y)).real for y in (Y, 0.0)))
    return (high - low) / a


def compacted(kind, law, cells):
    """Points' places at rest and after, Cauchy's vertical stress there, and volumes at rest."""
    h = HEIGHT / cells
    grid = Grid.box((0, 0), (h, HEIGHT), (1, cells))
    terms = [Fixed(grid.facets("left", "right"), "x"), Fixed(grid.facets("bottom"), "y"),
             Gravity(lambda t: (0.0, -G * t))]
    if kind is None:
        run = FiniteElements(grid, law, QuasiStatic(STEPS), terms)
        run.until(1.0)
        node = grid.space.tabulate_dof_coordinates()[:, 1]
        u = run.motion.nodal(run.displacement)[:, 1]
        Y = (np.arange(cells) + 0.5) * h
        line, first = np.unique(node.round(9), return_index=True)
        at_rest = np.argsort(run.sampler("stress")[0][:, 1])
        return Y, Y + np.interp(Y, line, u[first]), run.stress(np.arange(cells))[at_rest, 1], np.full(cells, h)
    body = MaterialPoints.fill(grid, law, 4)
    Y = body.x[:, 1].copy()
    run = Simulation(grid, body, QuasiStatic(STEPS), terms, kind)
    run.until(1.0)
    return Y, body.x[:, 1], body.stress[:, 1], body.mass / DENSITY


def errors(kind, law, cells):
    """Of stress, in the mean, against ρ₀g (l₀ - Y), relative to the base; and of places against Hencky's, relative to
    displacement."""
    Y, y, stress, volume = compacted(kind, law, cells)
    exact = place(Y, law.young)
    σ = np.abs(stress + DENSITY * G * (HEIGHT - Y)) @ volume / (DENSITY * G * HEIGHT * volume.sum())
    return σ, np.sqrt((y - exact) ** 2 @ volume / ((Y - exact) ** 2 @ volume))


@pytest.mark.parametrize("E", SOFT, ids=SOFT.get)
def test_the_answer_is_right(E):
    """Equilibrium solved point by point, and places added up."""
    for Y in (0.0, 13.0, 49.9):
        s = DENSITY * G * (HEIGHT - Y) / E
        assert stretch(Y, E) == pytest.approx(brentq(lambda λ, s=s: np.log(λ) / λ + s, 1e-3, 1.0), rel=1e-10)
        assert place(Y, E) == pytest.approx(quad(stretch, 0.0, Y, args=(E,))[0], rel=1e-10)


@pytest.mark.parametrize("E", SOFT, ids=SOFT.get)
@pytest.mark.parametrize("kind", [None, GIMP, DM_G, DM_GC], ids=lambda kind: str(kind or "FE"))
def test_henckys_column_converges(kind, E, record):
    """At first order in stress at least, as GIMP does in the literature; in places faster.

    Finite elements bear the exact weight at their centres, to Newton's tolerance.
    """
    found = np.array([errors(kind, Hencky(E, 0.0, DENSITY), n) for n in CELLS])
    record(f"1 compaction, {SOFT[E]}: stress at h = 0.625 m", kind or "FE", found[-1, 0])
    record(f"1 compaction, {SOFT[E]}: displacement at h = 0.625 m", kind or "FE", found[-1, 1])
    rate = np.log2(found[0] / found[-1]) / 3.0
    assert rate[1] > 1.5
    if kind is None:
        assert found[:, 0].max() < 1e-6
    else:
        assert rate[0] > 0.9
        assert (np.diff(found, axis=0) < 0.0).all()


@pytest.mark.parametrize("E", SOFT, ids=SOFT.get)
@pytest.mark.parametrize("kind", [MPM, CMPM, DM, DM_C], ids=str)
def test_linear_shape_functions_do_not(kind, E, record):
    try:
        coarse, fine = (errors(kind, Hencky(E, 0.0, DENSITY), n)[0] for n in CELLS[[0, -1]])
    except RuntimeError as error:
        record(f"1 compaction, {SOFT[E]}: stress at h = 0.625 m", kind, None, "points that cross cells on linear shape "
               "functions lose their stress: the run stops")
        assert "step" in str(error)
        return
    record(f"1 compaction, {SOFT[E]}: stress at h = 0.625 m", kind, fine, LOST)
    assert fine > max(coarse, 0.02)


@pytest.mark.parametrize("kind", [GIMP, DM_G, DM_GC], ids=str)
def test_the_small_strain_law_bears_the_weight_too(kind, record):
    """Its points, too, follow their volume; places differ from Hencky's by half the strain."""
    law = LinearElastic(1e6, 0.0, DENSITY)
    found = np.array([errors(kind, law, n) for n in CELLS])
    record("1 compaction, small strain, 4 %: stress at h = 0.625 m", kind, found[-1, 0])
    assert np.log2(found[0, 0] / found[-1, 0]) / 3.0 > 0.9
    assert 0.02 < found[-1, 1] < 0.04
