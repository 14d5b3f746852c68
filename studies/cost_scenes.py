"""The methods that are timed on ``scenes.pressed_block``: mappings and finite element twins, each
with the solver that it is timed with."""

from __future__ import annotations

from mpm_fenicsx import DM_G, DM_GC, MPM, Probe, Solver
from mpm_fenicsx.scenes.pressed_block import BODY, finite_elements, material_points

CELLS = {2: (0.125, 0.0625, 0.03125, 0.015625), 3: (0.375, 0.25, 0.1875)}  # m
REUSE = "DM-GC, reuse"
MAPPINGS = {
    **{m.name: {"mapping": m} for m in (MPM, DM_G, DM_GC)},
    REUSE: {"mapping": DM_GC, "solver": Solver(reuse=1e-3)},
}
CHOLESKY = Solver(
    petsc={
        "ksp_type": "preonly",
        "pc_type": "cholesky",
        "pc_factor_mat_solver_type": "mumps",
        "ksp_diagonal_scale": False,
        "ksp_diagonal_scale_fix": False,
    }
)
TWINS = {
    "FE": {"reassemble": True},
    "FE, Cholesky": {"reassemble": True, "solver": CHOLESKY},
    "FE, frozen": {"reassemble": False},
}
METHODS = (*MAPPINGS, *TWINS)


def scene(method: str, dim: int, cell: float, empty: int = 1, **options):
    """A run, with a stress probe; ``empty``: rows of cells above the body on the grid of material
    points; ``options`` of ``Simulation`` on top of the method's."""
    if method in TWINS:
        run = finite_elements(dim, cell, **TWINS[method])
    else:
        run = material_points(dim, cell, empty=empty, **MAPPINGS[method] | options)
    run.record(Probe("stress", [0.5 * length for length in BODY[dim]]))
    return run
