"""Composite strain that is linear across a direction, against a tensor product of polynomials."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import composite_across as study

from mpm_fenicsx import Grid


def test_both_are_the_same_along_and_the_tensor_product_is_exact_for_products_of_squares():
    grid, rng = Grid.box((0, 0), (3, 3), (3, 3)), np.random.default_rng(1)
    x, node = rng.uniform(1, 2, (5, 2)), grid.space.tabulate_dof_coordinates()[:, :2]
    cell, found = grid.find(x), {}
    cubic, product = node[:, :1] ** 3 * [1.0, 2.0], node[:, :1] ** 2 * node[:, 1:] ** 2 * [1.0, 2.0]
    for name, kind in study.ACROSS.items():
        composite = kind(grid)
        composite.place(np.ones(grid.cells, np.int8))
        found[name] = [composite.gradient_at_points(x, cell, f)[:, 0] for f in (cubic, product)]
        np.testing.assert_allclose(found[name][0][:, 0], 3 * x[:, 0] ** 2, rtol=1e-12)
    exact = np.stack((2 * x[:, 0] * x[:, 1] ** 2, 2 * x[:, 0] ** 2 * x[:, 1]), axis=1)
    np.testing.assert_allclose(found["tensor product"][1], exact, rtol=1e-12)
    assert np.abs(found["linear"][1] / exact - 1).max() > 1e-2


def test_linear_is_more_accurate_and_lets_no_energy_grow(tmp_path):
    rows = {
        (row["across"], row["scene"]): row
        for row in study.main(["--quick", "--results", str(tmp_path)])
    }
    assert (tmp_path / "composite_across.json").exists()
    for kind in ("shear", "pressure"):
        linear, tensor = (rows[across, f"{kind} wave, 10 cells"] for across in study.ACROSS)
        assert linear["error_displacement"] < 0.6 * tensor["error_displacement"]
        assert linear["error_stress"] < 0.85 * tensor["error_stress"]
    scene = "free block of 4 x 3 cells, 0 off, Courant 0.5"
    assert rows["linear", scene]["energy_left"] < 1.0 < rows["tensor product", scene]["energy_left"]
    assert rows["linear", scene]["energy_left"] == pytest.approx(0.7, abs=0.29)
