"""P and S waves in a column in 3D, held to the exact answer and to the column in plane strain."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from test_ranks import on_ranks

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import column_3d

from mpm_fenicsx import Energy, Solver, relative_error
from mpm_fenicsx.scenes import column
from mpm_fenicsx.scenes.column_3d import BASES, WAVES, Column3D, Watch, height, soil

COARSE = {"cell": 1.0, "step": 8e-3}  # Courant number 1


def watched(scene, make, until, **options):
    run = make(scene, **options)
    watch, energy = Watch(run, scene, until), run.record(Energy())
    run.until(until)
    return watch, energy


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("wave", WAVES)
def test_what_comes_up_again_is_what_the_base_sends_back(wave, base):
    scene = Column3D(wave, base, load=300.0, **COARSE)
    speed = scene.speed
    until = round(1.0 / scene.step) * scene.step
    watch, energy = watched(scene, Column3D.finite_elements, until)
    up, known = watch.upward()
    t = np.linspace(0.0, until, 5001)
    exact = watch.exact.velocity(height / 2, t) * scene.impedance
    exact = 0.5 * np.abs(exact - watch.exact.pressure(height / 2, t)).max() / scene.load
    if base != "viscoelastic":  # a fixed base sends back all of the load, dashpots nothing
        assert exact == pytest.approx({"fixed": 1.0, "viscous": 0.0}[base], abs=1e-3)
    # second order in the width of the pulse in cells, 0.5 s c / h: 63 (P) and 36 (S)
    assert np.abs(up - known).max() / scene.load < {"P": 0.05, "S": 0.08}[wave]
    assert relative_error(*watch.pairs()["displacement_mid"]) < {"P": 3e-3, "S": 5e-3}[wave]
    assert abs(energy.lost[-1]) < 1e-10 * energy["work"].max()
    assert np.abs(known[watch.times < 1.4 * height / speed]).max() < 1e-6 * scene.load


@pytest.mark.parametrize("base", ["fixed", "viscoelastic"])
def test_material_points_are_as_good_as_finite_elements(base):
    scene = Column3D("S", base, **COARSE)
    errors = [
        watched(scene, make, 0.8)[0].errors()
        for make in (Column3D.material_points, Column3D.finite_elements)
    ]
    for name, points in errors[0].items():
        assert points < 2 * errors[1][name] + 1e-5, name


def test_a_p_wave_is_that_of_the_column_in_plane_strain():
    scene = Column3D("P", "viscous", **COARSE)
    exact = Solver(petsc={"ksp_rtol": 1e-13})
    run = scene.material_points(solver=exact)
    plane = column.material_points("viscous", column.peak, cell=1.0, step=8e-3, solver=exact)
    (points,), (flat,) = run.bodies, plane.bodies
    levels = [  # points of one height at the start, 4 and 2 of them each
        np.lexsort((*body.x[:, [0, *range(2, body.dim)]].T, body.x[:, 1])).reshape(40, -1)
        for body in (points, flat)
    ]
    run.until(0.48)
    plane.until(0.48)
    for values, known in (
        (points.x[:, 1], flat.x[:, 1]),
        (points.velocity[:, 1], flat.velocity[:, 1]),
        (points.stress[:, 0], flat.stress[:, 0]),
        (points.stress[:, 1], flat.stress[:, 1]),
        (points.stress[:, 2], flat.stress[:, 2]),
    ):
        off = np.abs(values[levels[0]] - known[levels[1]][:, :1]).max()
        assert off < 1e-9 * np.abs(known).max()


def test_springs_of_the_exact_column_are_those_of_the_boundary():
    stiffness = [Column3D(wave, "viscoelastic").answer().spring for wave in WAVES]
    assert stiffness == [2 * soil.lame[1] / 20.0, soil.lame[1] / 40.0]


@pytest.mark.ranks
def test_two_ranks_print_once_and_write_the_same_rows(tmp_path):
    options = ["--cells", "1", "--waves", "S", "--bases", "viscous", "--until", "0.24", "--results"]
    rows = column_3d.main([*options, str(tmp_path / "one")])
    printed = on_ranks(2, column_3d.__file__, *options, tmp_path / "two")
    assert printed.count("figure:") == 1
    for one, two in zip(
        rows, json.loads((tmp_path / "two" / "column_3d.json").read_text()), strict=True
    ):
        for name in set(one) - {"seconds"}:
            same = one[name]
            if isinstance(same, float):
                same = pytest.approx(same, rel=1e-8, abs=1e-9)
            assert two[name] == same, name
    for folder in ("one", "two"):
        assert (tmp_path / folder / "column_3d.png").stat().st_size > 10_000
