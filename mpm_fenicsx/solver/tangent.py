"""The derivative of the residual, put into a matrix: by our own loop where it is linear in fields
over cells, by DOLFINx where it is not."""

from __future__ import annotations

import numpy as np
import ufl
from petsc4py import PETSc

from ..dynamics.motion import Motion
from ..grid import dolfinx_versions
from ..grid.form_degree import affine_in_fields
from ..grid.unit_tensors import UnitTensors
from .blocks import POSSIBLE
from .insertion import Insertion, Pairs


class Tangent:
    """The derivative of virtual ``work`` by the motion's u, and what is one already, a bilinear
    form ``stiffness``: over the cells of the motion's region and on whatever terms add.

    ``form``: all of it; ``compiled``: the same, as DOLFINx assembles it.  What is integrated over
    the region's cells alone, and is affine in fields as it is written down, goes straight into the
    matrix (``Insertion``); half of it where it is ``symmetric``.
    """

    def __init__(self, motion: Motion, work, stiffness=0, symmetric: bool = False):
        self._motion = motion
        u, trial = motion.u, ufl.TrialFunction(motion.grid.space)
        works, bilinear = _split(work, motion, u), _split(stiffness, motion, None)
        own, rest = (
            _sum(ufl.derivative(of, u, trial) if of is not None else None, also)
            for of, also in zip(works, bilinear, strict=True)
        )
        self.form = _sum(own, rest)
        self._unit = self._pairs = self._insertion = None
        if own is not None and POSSIBLE and motion.region.dS is None:
            nodes, size = 2**motion.grid.dim, motion.grid.dim
            for half in (True, False) if symmetric else (False,):
                self._pairs = Pairs(nodes, size, half)
                self._unit = UnitTensors.of(motion.grid, own, self._pairs.entries)
                if self._unit is None or self._unit.symmetric:
                    break
        if self._unit is None:
            self.compiled, self._rest = dolfinx_versions.compile_form(self.form), None
        else:
            self._rest = dolfinx_versions.compile_form(rest)
            self.compiled = dolfinx_versions.compile_form(own) + (self._rest or [])

    @property
    def inserts(self) -> bool:
        """Whether a part goes straight into the matrix, which then has all its places already."""
        return self._unit is not None

    def forget(self) -> None:
        """The matrix is another one from now on."""
        self._insertion = None

    def add(
        self, A: PETSc.Mat, bcs: list, fixed: np.ndarray, cells: np.ndarray | None = None
    ) -> None:
        """Add it to A, rows and columns of ``bcs``, the ``fixed`` ones (dofs,), bool, left empty
        but for a unit diagonal; A has been assembled before, and is to be after that.  ``cells``
        (n,): those that the form is over, if not the region's."""
        if not self.inserts:
            dolfinx_versions.assemble_matrix(A, self.compiled, bcs)
            return
        if self._insertion is None:
            self._insertion = Insertion(self._motion.grid, A, self._unit, self._pairs, fixed)
        self._insertion.add(A, self._motion.region.cells if cells is None else cells)
        if self._rest is not None:
            dolfinx_versions.assemble_matrix(A, self._rest, bcs)


def _split(form, motion: Motion, unknown) -> tuple[ufl.Form | None, ufl.Form | None]:
    """What of a form is integrated over the cells of the region, with a derivative by the
    ``unknown``, or of its own if that is None, that is affine in fields; and the rest."""
    parts = [] if isinstance(form, (int, float)) else form.integrals()
    mark = motion.region.dx.subdomain_id()
    mine = [
        part.integral_type() == "cell"
        and part.subdomain_id() in (mark, (mark,))
        and affine_in_fields(part, unknown)
        for part in parts
    ]
    found = (
        ufl.Form([part for part, one in zip(parts, mine, strict=True) if one is wanted])
        for wanted in (True, False)
    )
    own, rest = (None if of.empty() else of for of in found)
    return own, rest


def _sum(one: ufl.Form | None, other: ufl.Form | None) -> ufl.Form | None:
    if one is None or other is None:
        return other if one is None else one
    return one + other
