"""Cells of a far field become material points in mid-run."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np

from ..common.checks import chosen
from ..common.ranks import together
from ..common.tensors import strain
from ..mapping.shape_functions import Stencil
from ..materials.material import hooke
from ..points.material_points import MaterialPoints
from ..terms.far_field import FarField


def release(run, where: Callable, per_cell: int | None = None, material=None) -> MaterialPoints:
    """Fill the cells of the run's far fields whose centres x (dim, n), m, lie where ``where`` says
    with ``per_cell`` material points each, which take displacement gradient, velocity and
    acceleration of the finite elements there, and leave the far field without them.

    ``material``: that of the points, by default the far field's, of which the cells must then have
    one.  The new body is the last of ``run.bodies``, and is returned.  Collective.
    A checkpoint of the run is for one that has released the same cells, before ``restart``.
    Raises ``ValueError`` for cells of no far field, or of several materials.
    """
    grid, dim = run.grid, run.grid.dim
    with together(grid.comm, Exception):
        asked = chosen("where", where, grid.centres.T)
    fields = [(t, run.scene.part(t)) for t in run.terms if isinstance(t, FarField)]
    taken = [(term, part, asked & part.marks) for term, part in fields]
    taken = [one for one in taken if grid.comm.allreduce(int(one[2].any()))]
    if len(taken) != 1:
        raise ValueError(
            f"where: a release is of cells of one far field, and these are of {len(taken)}"
        )
    ((term, part, marks),) = taken
    laws = [law for law, region in term.materials() if region is None or _has(grid, region, marks)]
    if material is None and len(laws) != 1:
        raise ValueError(
            f"where: these cells are of {len(laws)} materials: release them one by one, or give "
            "the material of the points"
        )
    law = laws[0] if material is None else material

    def inside(x: np.ndarray) -> np.ndarray:
        cell = grid.find(np.ascontiguousarray(x.T))
        return (cell >= 0) & marks[cell]

    body = MaterialPoints.fill(grid, law, 2**dim if per_cell is None else per_cell, inside)
    cell = grid.find(body.x)
    hats = Stencil(grid, len(body), support=False)
    hats.place(body.x, None, cell)
    U = run.motion.nodal(part.U)
    elastic = laws[0].lame if len(laws) == 1 else law.lame
    body.stress = hooke(elastic, strain(hats.gradient_at_points(U)), np.zeros_like(body.stress))
    if run.stepping.dynamic:
        V, A = (run.motion.nodal(f) for f in (part.V, part.A))
        body.velocity, body.acceleration = hats.at_points(V), hats.at_points(A)
    now = {name: value.copy() for name, value in run.state().items()}
    run.bodies.append(body)
    run.terms = [one.without(where) if one is term else one for one in run.terms]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run.build()
    for name, value in run.state().items():
        if name in now:
            value[...] = now[name]
    for part in run.scene.plain:
        part.trim()
    run.arrangement += 1
    run.released += grid.comm.allreduce(int(marks[: grid.owned_cells].sum()))
    for recorder in run.recorders:
        if hasattr(recorder, "moved"):
            recorder.moved(run)
    return body


def _has(grid, region: Callable, marks: np.ndarray) -> bool:
    with together(grid.comm, Exception):
        held = chosen("where", region, grid.centres.T)
    return bool(grid.comm.allreduce(int((held & marks).any())))
