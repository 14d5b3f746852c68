"""The consistent mass of a density, times nodal values."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem

from ..common.compiled import jit, once
from . import dolfinx_versions, weak_forms
from .form_degree import affine_in_fields
from .grid import Grid
from .unit_tensors import UnitTensors, tensors


class ConsistentMass:
    """M_ij = ∫ ρ N_i N_j of a density ρ (kg/m³), a field or a constant that ``dx`` integrates: cell
    by cell with the unit tensors of that form, or by DOLFINx where there are none."""

    def __init__(self, grid: Grid, density, dx: ufl.Measure):
        self.grid, self._density, self._dx = grid, density, dx
        V = dolfinx_versions.space(grid.mesh, "Lagrange", 1)
        self._nodes = dolfinx_versions.cell_dofs(V)
        form = weak_forms.inertia(density, ufl.TrialFunction(V), ufl.TestFunction(V)) * dx
        nodes = 2**grid.dim
        self._pairs = np.stack(np.triu_indices(nodes), axis=1)
        fits = all(map(affine_in_fields, form.integrals()))
        entries = self._pairs @ np.array([nodes, 1])
        self._unit = UnitTensors.of(grid, form, entries) if fits else None
        self._forms: dict[int, tuple] = {}

    def add_times(self, values: np.ndarray, cells: np.ndarray, out: np.ndarray) -> None:
        """Add M q of nodal ``values`` q (nodes, m) to ``out`` (nodes, m); M of this rank's
        ``cells`` (n,), those of ``dx``."""
        if self._unit is None:
            f, product, form = self._form(values.shape[1])
            f.x.array[:], product.x.array[:] = values.ravel(), 0.0
            dolfinx_versions.assemble_vector(product, form)
            out += product.x.array.reshape(out.shape)
            return
        self._unit.refresh()
        given, where = self._unit.arguments(), (self._nodes, self._pairs)
        columns = once(values.shape[1])
        _add(columns, self._unit.by_kind(cells), given, where, values, out)

    def _form(self, columns: int) -> tuple[fem.Function, fem.Function, list]:
        """Of so many columns: a field of values, one of products, and the form between them."""
        if columns not in self._forms:
            V = dolfinx_versions.space(self.grid.mesh, "Lagrange", 1, (columns,))
            f = fem.Function(V)
            form = weak_forms.inertia(self._density, f, ufl.TestFunction(V)) * self._dx
            self._forms[columns] = f, fem.Function(V), dolfinx_versions.compile_form(form)
        return self._forms[columns]


@jit
def _add(columns, cells, given, where, values, out):
    """out_i += Σ_j M_ij q_j, cell by cell; ``cells`` of ``UnitTensors.by_kind``, ``given`` its
    ``arguments``; ``where`` (nodes, pairs i ≤ j)."""
    tables, of, start = cells
    fields, dofs, weights, found = given
    nodes, pairs = where
    for kind in range(len(tables)):
        for first in range(start[kind], start[kind + 1], len(weights)):
            some = of[first : min(first + len(weights), start[kind + 1])]
            tensors(tables[kind], some, fields, dofs, weights, found)
            for row in range(len(some)):
                for p in range(len(pairs)):
                    mass = found[row, p]
                    i, j = nodes[some[row], pairs[p, 0]], nodes[some[row], pairs[p, 1]]
                    for f in range(len(columns)):
                        out[i, f] += mass * values[j, f]
                    if i != j:
                        for f in range(len(columns)):
                            out[j, f] += mass * values[i, f]
