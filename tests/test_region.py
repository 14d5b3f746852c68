"""Measures of cells against the volumes of those cells."""

import numpy as np
from dolfinx import fem

from mpm_fenicsx import Grid
from mpm_fenicsx.grid import dolfinx_versions
from mpm_fenicsx.grid.active_cells import Region


def test_measures_of_some_cells_know_nothing_of_one_another():
    """Each integrates over the cells that it was told of last, in forms that are compiled already,
    too."""
    grid = Grid.rectilinear([np.array([0.0, 1.0, 3.0, 6.0]), np.array([0.0, 1.0, 2.0])])
    region, size = Region(grid), grid.lattice.volume
    one = fem.Constant(grid.mesh, np.array(1.0))
    (left, to_left), (right, to_right) = (region.some({"quadrature_degree": k}) for k in (1, 2))
    both = dolfinx_versions.compile_form(one * left + 2 * one * right + 4 * one * region.dx)
    for told in (
        (range(6), range(6), range(6)),
        ([0, 3], [1], [0]),
        ([5], [], [0]),
        ([5], [1, 2], [4]),
    ):
        a, b, held = (np.array(list(cells), np.int32) for cells in told)
        if len(a) < 6:
            to_left(a)
            to_right(b)
            mark = np.zeros(grid.cells, np.int8)
            mark[held] = 1
            region.cover(mark)
        wanted = size[a].sum() + 2 * size[b].sum() + 4 * size[region.cells].sum()
        if not region.follows:
            wanted = 7 * size.sum()
        np.testing.assert_allclose(dolfinx_versions.assemble_scalar(both), wanted, rtol=1e-14)
    if region.follows:
        assert len(region.cells) < 6
