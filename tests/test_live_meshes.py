"""A process makes as many runs as it likes, one after the other."""

import gc
import time
import weakref

import ufl
from dolfinx import fem

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions


def test_grids_that_nobody_asks_for_leave_their_communicators():
    """Some 290 at a time are all that MPI has communicators for; here they are kept by what refers
    to itself, as a run does, and Python frees nothing by itself (``conftest.py``)."""
    assert not gc.isenabled()
    for _ in range(330):
        kept = [mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (1, 1))]
        kept.append(kept)


def test_a_form_that_was_compiled_anew_is_freed_with_its_mesh():
    """UFL's visitors keep forms, but no longer than until the next grid is made."""
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (1, 1))
    u, w = ufl.TrialFunction(grid.space), ufl.TestFunction(grid.space)
    field = fem.Function(grid.space)
    work = time.time_ns() * 1e-19 * ufl.inner(ufl.grad(field), ufl.grad(w)) * ufl.dx
    form = dolfinx_versions.compile_form(ufl.derivative(work, field, u))
    mesh = weakref.ref(grid.mesh)
    del grid, u, w, field, work, form
    mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (1, 1))
    gc.collect()
    assert mesh() is None
