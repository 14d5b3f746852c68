"""The footing in 3D: against the exact series at rest, and a quarter of it against the whole."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_ranks import on_ranks

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import footing_3d

from mpm_fenicsx import Energy, Solver
from mpm_fenicsx.analytical import footing
from mpm_fenicsx.scenes.footing_3d import Footing, clay, cohesion, soil

E, ν = soil.young, soil.poisson
M = soil.lame[0] + 2 * soil.lame[1]  # confined modulus
SMALL = Footing("fixed", width=2.0, depth=2.0, load=10e3)


# -- what is exact ---------------------------------------------------------------------------------


def test_the_layer_is_confined_for_long_waves_and_a_half_space_for_short_ones():
    long, short = footing.layer_compliance(np.array([0.0, 50.0]), 3.0, E, ν)
    assert long == pytest.approx(3.0 / M, rel=1e-7)
    assert short == pytest.approx(2 * (1 - ν**2) / E / 50.0, rel=1e-12)


def test_a_layer_under_a_cosine_settles_as_said():
    """Four constants by numbers: no displacement at the base, no shear and a given pressure on the
    surface."""
    G, k, H = soil.lame[1], 0.7, 2.0
    # Navier's equations, y down from the surface: u_y = V(y) cos kx, u_x = U(y) sin kx with
    # V = (A + B y) e^-ky + (C + D y) e^ky, U = (A + B (y - κ/k)) e^-ky - (C + D (y + κ/k)) e^ky
    e, f, κ, λ = np.exp(-k * H), np.exp(k * H), 3 - 4 * ν, soil.lame[0]
    base_V = [e, H * e, f, H * f]
    base_U = [e, (H - κ / k) * e, -f, -(H + κ / k) * f]
    V, U = np.array([1.0, 0.0, 1.0, 0.0]), np.array([1.0, -κ / k, -1.0, -κ / k])
    V_y, U_y = np.array([-k, 1.0, k, 1.0]), np.array([-k, 1.0 + κ, -k, -(1.0 + κ)])
    normal, shear = (λ + 2 * G) * V_y + λ * k * U, U_y - k * V
    constants = np.linalg.solve([base_V, base_U, normal, shear], [0.0, 0.0, -1.0, 0.0])
    assert footing.layer_compliance(k, H, E, ν) == pytest.approx(V @ constants, rel=1e-9)


def test_a_box_that_is_loaded_all_over_is_confined():
    box = (2.0, 3.0), (2.0, 3.0), 1.5, 1e3, E, ν
    everywhere = footing.settlement_of_a_box(np.array([[0.0, 0.0], [1.0, 2.5]]), *box)
    assert everywhere == pytest.approx(1e3 * 1.5 / M, rel=1e-7)
    assert footing.mean_settlement_of_a_box(*box) == pytest.approx(1e3 * 1.5 / M, rel=1e-7)


def test_a_large_box_settles_as_schleichers_half_space():
    """Walls and base at L take away a share that goes as 1/L; between L and 2L it is taken out."""
    scene = replace(SMALL, half=(1.0, 0.6))
    exact, place = scene.on_a_half_space, np.zeros((1, 2))
    near, far = (
        footing.settlement_of_a_box(place, (1.0, 0.6), (L, L), L, 10e3, E, ν, terms=round(60 * L))[
            0
        ]
        for L in (16.0, 32.0)
    )
    assert near < far < exact
    assert 2 * far - near == pytest.approx(exact, rel=2e-3)


# -- at rest ---------------------------------------------------------------------------------------


@pytest.mark.validation
def test_at_rest_the_error_falls_with_the_cells():
    found = [
        footing_3d.at_rest(replace(SMALL, cell=cell, width=3.0, depth=3.0)) for cell in (1.0, 0.5)
    ]
    coarse, fine, points = zip(*found, strict=True)
    assert abs(fine[0]["centre_off"]) < 0.5 * abs(coarse[0]["centre_off"])
    assert abs(fine[1]["centre_off"]) < 0.5 * abs(coarse[1]["centre_off"])
    # the mean is the energy: finite elements are too stiff; the footing's edge, where stress has a
    # jump, leaves order 1.5
    assert coarse[1]["mean_off"] < fine[1]["mean_off"] < 0.0
    assert fine[1]["mean_off"] / coarse[1]["mean_off"] < 0.5**1.4
    for name in ("centre_off", "mean_off"):
        assert abs(points[1][name]) < 0.04


# -- in time ---------------------------------------------------------------------------------------


def test_a_quarter_is_the_whole():
    """Of finite elements to round-off.  Not so of material points: composite patches end at a plane
    of symmetry, where inside the whole they go on, and what supports know of velocity is taken up
    by the points beside them."""
    quarter = replace(SMALL, boundary="viscoelastic", half=(1.0, 0.5), step=4e-3)
    exact = Solver(petsc={"ksp_rtol": 1e-13})
    whole = replace(quarter, full=True)
    runs = [scene.finite_elements() for scene in (quarter, whole)]
    energy = [run.record(Energy()) for run in runs]
    for run in runs:
        run.until(10 * quarter.step)
    for name in ("work", "kinetic", "strain", "absorbed", "stored"):
        assert energy[1][name] == pytest.approx(4 * energy[0][name], rel=1e-9, abs=1e-9), name

    runs = [scene.material_points(solver=exact) for scene in (quarter, whole)]
    (part,), (body,) = (run.bodies for run in runs)
    mine = (body.x[:, 0] > 0) & (body.x[:, 2] > 0)
    order = [np.lexsort(np.round(x, 6).T) for x in (part.x, body.x[mine])]
    start = part.x[order[0]]
    for run in runs:
        run.until(10 * quarter.step)
    moved, known = part.x[order[0]] - start, body.x[mine][order[1]] - start
    assert np.abs(moved - known).max() < 0.01 * np.abs(known).max()


@pytest.mark.parametrize(
    "boundary", ["fixed", pytest.param("viscoelastic", marks=pytest.mark.validation)]
)
def test_material_points_and_finite_elements_approach_one_another(boundary):
    apart = []
    for cell in (0.5, 0.25):
        scene = replace(SMALL, boundary=boundary, cell=cell, step=4e-3 * cell)
        (row, (_, points)), (twin, (_, elements)) = (
            footing_3d.measure(make(scene), scene, 0.04)
            for make in (Footing.material_points, Footing.finite_elements)
        )
        apart.append(np.abs(points - elements).max() / elements.max())
        assert abs(twin["energy_lost"]) < 1e-10 and abs(row["energy_lost"]) < 0.02
    assert apart[1] < 0.5 * apart[0] < 0.05


def test_before_an_edge_is_felt_the_centre_sinks_as_a_column():
    """v = p/(ρ c_p) until the P wave comes from the nearest edge; a load at once comes within the
    first step."""
    scene = replace(SMALL, half=(1.5, 1.5), cell=0.25, step=1e-3, ramp=0.0)
    run = scene.finite_elements()
    probe = run.record(scene.settlement(run))
    run.until(0.01)  # 1.2 of 1.5 m
    exact = scene.load / (soil.density * soil.p_speed) * (0.01 - 0.5 * scene.step)
    assert -probe.values[-1, 1] == pytest.approx(exact, rel=0.02)


@pytest.mark.validation
def test_clay_flows_under_four_times_its_cohesion():
    scene = replace(SMALL, boundary="viscoelastic", law=clay, load=4 * cohesion)
    run = scene.material_points()
    row, _ = footing_3d.measure(run, scene, 0.05)
    elastic, _ = footing_3d.measure(
        replace(scene, law=soil).material_points(), replace(scene, law=soil), 0.05
    )
    assert row["plastic_of_work"] > 0.05 and elastic["plastic_of_work"] == 0.0
    assert row["largest_mm"] > 1.1 * elastic["largest_mm"]
    assert abs(row["energy_lost"]) < 0.02


@pytest.mark.ranks
def test_the_script_writes_the_same_on_two_ranks(tmp_path):
    options = ["--cells", "1", "--until", "0.04", "--results"]
    found = footing_3d.main([*options, str(tmp_path / "one")])
    printed = on_ranks(2, footing_3d.__file__, *options, tmp_path / "two")
    assert printed.count("figure:") == 1
    several = json.loads((tmp_path / "two" / "footing_3d.json").read_text())
    for part, rows in found.items():
        for one, two in zip(rows, several[part], strict=True):
            for name in set(one) - {"seconds"}:
                same = one[name]
                if isinstance(same, float):
                    same = pytest.approx(same, rel=1e-6, abs=1e-7)
                assert two[name] == same, name
    for folder in ("one", "two"):
        assert (tmp_path / folder / "footing_3d.png").stat().st_size > 10_000
