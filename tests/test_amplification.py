"""The amplification matrix of the study: it is what real steps do, and has the eigenvalues that are
known."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import amplification
from amplification_map import StepMap, crossing, growth

from mpm_fenicsx import DM_G, DM_GC, GIMP, MPM, Fixed, Grid, MaterialPoints, Newmark, Simulation
from mpm_fenicsx.scenes.block import bar, block, h, soil, step_of

MAPPINGS = pytest.mark.parametrize("mapping", [MPM, GIMP, DM_G, DM_GC], ids=str)


@MAPPINGS
@pytest.mark.parametrize("scene", [bar, block])
def test_a_power_of_the_matrix_is_so_many_real_steps(scene, mapping):
    """Random points' values, whatever of them the grid does not see, over cut cells and on
    dashpots."""
    run, rng = scene(mapping, step_of(0.7), viscous=True, offset=0.3), np.random.default_rng(0)
    steps, n = StepMap(run), len(run.bodies[0])
    T = steps.matrix
    steps.put(*(1e-9 * rng.normal(size=k * n) for k in (3, 2, 2)))
    z = steps.nodal()
    for _ in range(5):
        run.step()
    found, expected = steps.nodal(), np.linalg.matrix_power(T, 5) @ z
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@MAPPINGS
def test_rigid_motions_are_neutral(mapping):
    """Two translations and a rotation of a free block keep their velocity; nothing else is
    neutral."""
    λ = np.linalg.eigvals(StepMap(block(mapping, step_of(1.0))).matrix)
    assert (np.abs(λ - 1) < 1e-9).sum() == 3
    assert (np.abs(λ - 1) < 1e-4).sum() == 3


def test_one_point_on_one_element_by_hand():
    """Points at ¼ and ¾ of a cell that is fixed on its left, MPM without sweeps: their velocities
    and stress in closed form, with k = 2V c²ρ/h² and m = Σ m_p x_p²/h² of the right-hand node."""
    courant, x = 1.3, np.array([0.25, 0.75])
    run = bar(replace(MPM, sweeps=0), step_of(courant), cells=1, fixed=True)
    run.supports = None  # with it a step knows more of points than what they deposit
    λ = np.linalg.eigvals(StepMap(run).matrix)
    dt, c = step_of(courant).dt, soil.p_speed
    N = np.stack((1 - x, x))  # of the nodes, at the points; both have mass 1/2
    D = N / N.sum(axis=1)[:, None]
    m, k = (x**2).mean(), (c / h) ** 2
    T = []
    for f, v, a in np.eye(3):  # of the right-hand node: that on the left is known to be at rest
        u = (m * (4 / dt * v + a) - f) / (k + 4 * m / dt**2)
        filtered = (D @ N.T)[1, 1] * (4 / dt**2 * u - 4 / dt * v - a)
        T.append([f + k * u, v + dt / 2 * (a + filtered), filtered])
    expected = np.linalg.eigvals(np.array(T).T)
    for value in expected:
        assert np.abs(λ - value).min() < 1e-7
    assert np.abs(np.abs(expected) - 1).max() > 1e-3


def test_growth_is_that_of_a_run():
    """The paper's DM-GC, a free block of 4 by 3 cells: 40 steps from its fastest growing mode, no
    places put back."""
    run = amplification.across(block(amplification.PAPERS, step_of(0.5)))
    steps = StepMap(run)
    λ, modes = np.linalg.eig(steps.matrix)
    i = np.argmax(np.abs(λ))
    found = growth(steps.matrix, 0.5)
    assert found["growth"] == pytest.approx(abs(λ[i]) - 1) == pytest.approx(6.7e-3, rel=0.01)
    assert found["frequency"] == pytest.approx(0.70, abs=0.01)
    assert found["modes"] == 1
    steps.hold(1e-8 * modes[:, i].real)
    for _ in range(40):
        run.step()
    expected = 1e-8 * (λ[i] ** 40 * modes[:, i]).real
    np.testing.assert_allclose(steps.nodal(), expected, atol=1e-5 * np.abs(expected).max())


def test_what_the_paper_lets_grow_does_not_grow_here():
    assert growth(StepMap(block(DM_GC, step_of(0.5))).matrix, 0.5)["growth"] < -1e-3


@pytest.mark.parametrize("courant", [0.5, 5.0])
@pytest.mark.parametrize("mapping", [MPM, GIMP], ids=str)
def test_integrals_at_points_let_nothing_grow_at_rest(mapping, courant):
    for offset in (0.0, 0.3):
        assert (
            growth(StepMap(block(mapping, step_of(courant), offset=offset)).matrix, courant)[
                "growth"
            ]
            < 0.0
        )


@pytest.mark.parametrize("mapping", [GIMP, DM_GC], ids=str)
def test_the_product_of_ten_maps_is_ten_steps_of_a_bar_that_moves(mapping):
    stepping, cells, speed, rng = step_of(2.0), 4, 0.3, np.random.default_rng(1)
    P = crossing(mapping, stepping, speed, 10, cells)
    grid = Grid.box((-3 * h, 0), ((cells + 7) * h, h), (cells + 10, 1))
    body = MaterialPoints.fill(grid, soil, 4, inside=lambda x: (x[0] > 0) & (x[0] < cells * h))
    column = np.unique(body.x[:, 0].round(9), return_inverse=True)[1]
    z, c = 1e-8 * rng.normal(size=(3, 2 * cells)), soil.p_speed
    rigid = speed * h / stepping.dt
    body.stress[:, 0] = soil.density * c**2 * z[0, column]
    body.velocity, body.acceleration = np.zeros_like(body.x), np.zeros_like(body.x)
    body.velocity[:, 0], body.acceleration[:, 0] = (
        rigid + c * z[1, column],
        c / stepping.dt * z[2, column],
    )
    run = Simulation(
        grid,
        body,
        Newmark(stepping.dt),
        [Fixed(grid.facets("bottom", "top"), "y")],
        replace(mapping, hold_cut_cells=False),
    )
    for _ in range(10):
        run.step()
    first = np.unique(column, return_index=True)[1]
    found = np.concatenate(
        (
            body.stress[first, 0] / (soil.density * c**2),
            (body.velocity[first, 0] - rigid) / c,
            body.acceleration[first, 0] * stepping.dt / c,
        )
    )
    expected = P @ z.ravel()
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_the_study_writes_its_rows(tmp_path, monkeypatch):
    monkeypatch.setattr(
        amplification,
        "cases",
        lambda quick: [
            (
                {
                    "motion": "at rest",
                    "scene": "bar, free",
                    "mapping": "GIMP",
                    "sweeps": 1,
                    "offset": 0.0,
                    "radius": 1.0,
                    "start": 0.0,
                    "strain": "as it is",
                    "courant": C,
                },
                lambda C=C: growth(StepMap(bar(GIMP, step_of(C), cells=3)).matrix, C),
            )
            for C in (0.5, 5.0)
        ],
    )
    rows = amplification.main(["--results", str(tmp_path)])
    written = json.loads((tmp_path / "amplification.json").read_text())
    assert written["rows"] == rows and len(rows) == 2
    assert all(row["growth"] < 0 for row in rows)
    assert (tmp_path / "amplification.png").stat().st_size > 10_000
