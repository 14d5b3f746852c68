"""From a measure carried by points to a discontinuous field on the grid.

Both ways below write, for every cell c and node k of it,

    q_ck = Σ_p V_p q_p / |c| · ψ_k averaged over the part of p's support domain that lies in c

and differ in the functions ψ only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from ..common.compiled import digits, jit, once
from ..grid import dolfinx_versions
from ..grid.grid import Grid
from .shape_functions import Stencil

FEW = 4
"""Of so many times the points of a surface, a grid has more cells: then only those cells are
cleared that hold some."""


@dataclass(frozen=True, eq=False, repr=False)
class Integration:
    """Where the integrals of mass and stiffness are taken.

    ``degree`` of the discontinuous space; ``dual`` (k, k) coefficients of ψ_k in powers of ξ,
    direction by direction; ``quadrature`` degree that makes the forms' integrals exact.
    """

    name: str
    degree: int
    dual: np.ndarray
    quadrature: int

    def __repr__(self) -> str:
        return self.name

    @property
    def nodal(self) -> np.ndarray:
        """Coefficients (k, k) of the space's own shape functions, direction by direction, in powers
        of ξ."""
        return HATS if self.degree == 1 else QUADRATICS


HATS = np.array([[1.0, -1.0], [0.0, 1.0]])  # 1 - ξ and ξ, in powers of ξ
QUADRATICS = np.array(
    [[1.0, -3.0, 2.0], [0.0, 4.0, -4.0], [0.0, -1.0, 2.0]]
)  # through 0, ½, 1, in powers of ξ
SIMPSON = np.array([1.0, 4.0, 1.0]) / 6.0


def _moments() -> np.ndarray:
    """ψ = M⁻¹ g for the quadratics g through 0, ½, 1 with mass matrix M: then ∫ q_h g = Σ_p V_p q_p
    g(x_p)."""
    g = QUADRATICS
    powers = 1.0 / (np.arange(3)[:, None] + np.arange(3) + 1.0)
    return np.linalg.solve(g @ powers @ g.T, g)


AT_POINTS = Integration("points", 2, _moments(), 5)
"""Point sums, exact: every product of two linear functions is a quadratic."""

AT_NODES = Integration("nodes", 2, QUADRATICS / SIMPSON[:, None], 3)
"""Point sums, exact, with Simpson's rule (``simpson``).

Its round-off is small where the sum is: a point ξ beyond a cell's edge gives ξ² to the far node,
and here 1e-16 ξ of noise, where Gauss points leave 1e-16 and with it a matrix that is indefinite.
"""


def simpson(dim: int) -> dict[str, object]:
    """Metadata of the measure that goes with ``AT_NODES``."""
    place = digits(3, dim)
    return {
        "quadrature_rule": "custom",
        "quadrature_degree": AT_NODES.quadrature,
        "quadrature_points": place / 2.0,
        "quadrature_weights": SIMPSON[place].prod(axis=1),
    }


DOUBLE_MAPPED = Integration("Gauss points", 1, 2.0 * HATS, 3)
"""Double mapping, eq. (7): ψ_k = N_k / m_k, m_k the integral of N_k over the reference cell."""


class Projection:
    """Projects ``fields`` values a point at once to as many discontinuous fields."""

    def __init__(self, grid: Grid, integration: Integration, fields: int):
        self.grid, self.integration = grid, integration
        V = dolfinx_versions.space(grid.mesh, "DQ", integration.degree)
        self.fields = [fem.Function(V) for _ in range(fields)]
        self.dofs = grid.tensor_order(V, integration.degree).astype(np.uint32)
        self._written: slice | np.ndarray = slice(None)  # dofs that may not be zero

    def clear(self) -> None:
        """Forget what was added."""
        for f in self.fields:
            f.x.array[self._written] = 0.0
        self._written = np.zeros(0, dtype=np.uint32)

    def add(self, stencil: Stencil, values: np.ndarray) -> None:
        """Add volume-weighted values V_p q_p (n, fields) of the points of a stencil."""
        lat, dual = stencil.lattice, self.integration.dual
        few = (
            len(stencil.reach) == 2
            and FEW * len(stencil) < self.grid.cells
            and self.grid.comm.size == 1
        )
        if few and not isinstance(self._written, slice):
            self._written = np.append(self._written, self.dofs[np.unique(stencil.cell)])
        else:
            self._written = slice(None)
        if self.fields:
            _project(
                self.grid.axes,
                once(len(dual)),
                once(values.shape[1]),
                stencil.cut,
                (stencil.cell, lat.volume, lat.neighbour),
                (dual, self.dofs),
                values,
                tuple(f.x.array for f in self.fields),
            )

    def finish(self) -> None:
        """Add up the fields over all ranks."""
        for f in self.fields:
            dolfinx_versions.gather(f)


@jit
def _project(axes, nodes, columns, cut, cells, space, values, out):
    """Cell by cell, add each point's values to the dofs of a discontinuous field.

    out_ck += q_p / |c| ∏_d Σ_j dual_kj ⟨ξ^j⟩, the mean of ξ^j taken over the segment of the support
    domain in c. ``values`` (n, columns) are volume-weighted; ``dofs`` (cells, nodes^dim), x
    fastest; ``out``: one (dofs,) a column.
    ``cut`` (side, span, share); ``cells`` (cell of each point, volume, neighbour); ``space`` (dual,
    dofs).
    """
    side, span, share = cut
    cell, volume, neighbour = cells
    dual, dofs = space
    dim, n = len(axes), len(nodes)
    line = np.empty((dim, 2, n))
    for p in range(len(cell)):
        for d in range(dim):
            for s in range(2 if side[p, d] != 0 else 1):
                a, b = span[p, d, s, 0], span[p, d, s, 1]
                for j in range(n):
                    w = dual[j, 0] + dual[j, 1] * 0.5 * (a + b)
                    if n == 3:
                        w += dual[j, 2] * (a * a + a * b + b * b) / 3.0
                    line[d, s, j] = share[p, d, s] * w
        for r in range(2 if dim == 3 and side[p, 2] != 0 else 1):
            above = cell[p] if r == 0 else neighbour[cell[p], 2, (side[p, 2] + 1) // 2]
            for s in range(2 if side[p, 1] != 0 and above >= 0 else 1):
                beside = above if s == 0 else neighbour[above, 1, (side[p, 1] + 1) // 2]
                for t in range(2 if side[p, 0] != 0 and beside >= 0 else 1):
                    c = beside if t == 0 else neighbour[beside, 0, (side[p, 0] + 1) // 2]
                    if c < 0:
                        continue
                    per_volume = 1.0 / volume[c]
                    for k in range(n if dim == 3 else 1):
                        for j in range(n):
                            across = per_volume * line[1, s, j]
                            across *= line[2, r, k] if dim == 3 else 1.0
                            for i in range(n):
                                w = across * line[0, t, i]
                                dof = dofs[np.uint64(c), np.uint64(i + n * (j + n * k))]
                                for f in range(len(columns)):
                                    out[f][dof] += w * values[p, f]
