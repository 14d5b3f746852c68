"""Virtual work of cells of complex length, and how they follow in time.

With stretches s_j = κ_j + β_j/p, N_m = s_m U and M_j = (s_k s_m/s_j) U, where j, k, m are the three
directions (in 2D s_m = 1 and N = U),

    ∫ Σ_j P_j·∂_j w + ρ p² s_1 s_2 s_3 U·w dx,

P_j being column j of the stress of that gradient whose column j is ∂_j M_j and whose others, l ≠ j,
are ∂_l N_m with m the third direction.  By the trapezoidal rule, H = Δt/2, and I = ∫U dt,

    I' = I + Δt U + H u,   N_m' = κ_m U' + β_m I',
    (κ_j + β_j H) M_j' = (κ_j − β_j H) M_j + (κ_k + β_k H) N_m' − (κ_k − β_k H) N_m:

what the increment u adds is what the real stretches s_j(1/H) would.
"""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from ufl import grad, inner

from ..common.compiled import digits, jit
from ..common.spread import Spread
from ..grid import dolfinx_versions
from ..grid.grid import Grid
from .contribution import Contribution
from .plain_cells import PlainCells

GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
MIDPOINT = np.array([0.5])


class StretchedCells:
    """Plain cells whose lengths are stretched.

    ``kappa`` (-) and ``beta`` (1/s), (cells, dim): of every direction; ``across`` (cells, dim),
    bool: in which directions the midpoint rule is taken.
    """

    def __init__(self, part: PlainCells, kappa: np.ndarray, beta: np.ndarray, across: np.ndarray):
        self.part, self.motion, self.grid = part, part.motion, part.grid
        self._kappa, self._beta = kappa, beta
        grid, dim = self.grid, self.grid.dim
        self._rules = _rules(grid, part, across)
        self._κ = [_everywhere(grid, part, kappa[:, d], 1.0) for d in range(dim)]
        self._β = [_everywhere(grid, part, beta[:, d], 0.0) for d in range(dim)]
        V = dolfinx_versions.space(grid.mesh, "DQ", 1, (dim,))
        self._fields = [fem.Function(V) for _ in range(dim)]  # of M
        # dofs come cell by cell, those of a cell in the order of its nodes
        self._nodes = dolfinx_versions.cell_dofs(grid.space)
        self.M = [f.x.array.reshape(grid.cells, 2**dim, dim) for f in self._fields]
        axes = _axes(grid)[part.cells]
        self._across = [1 << np.argmax(axes == j, axis=1) for j in range(dim)]
        self._sum = fem.Function(grid.space)  # ∫U dt

    def work(self, w, end: float, start: float):
        """Virtual work against w of what is there at the end of the step, times ``end``, and at
        its start, times ``start``: a form."""
        integrand = self._integrand(w, end, start)
        return sum(factor * integrand * dx for factor, dx in self._rules)

    def _integrand(self, w, end: float, start: float):
        dim, λ, μ = self.grid.dim, self.part.λ, self.part.μ
        U, total = self._displacement(end, start), self._integral(end, start)
        work = 0
        for j in range(dim):
            columns = {j: _slope(self._m(j, end, start))[:, j]}
            for other in range(dim):
                if other != j:
                    third = 3 - j - other if dim == 3 else None
                    columns[other] = _slope(self._n(third, U, total))[:, other]
            g = ufl.as_tensor([[columns[d][i] for d in range(dim)] for i in range(dim)])
            stress = λ * ufl.tr(g) * ufl.Identity(dim) + μ * (g + g.T)
            work += inner(stress[:, j], grad(w)[:, j])
        return work + self.part.density * inner(self._inertia(U, total, end, start), w)

    # -- sums of fields: by the field, factors that are the same all over a cell -------------------

    def _displacement(self, end: float, start: float) -> dict:
        return {**self._step(end), self.part.U: end + start}

    def _step(self, factor) -> dict:
        """What the step adds to the displacement."""
        brought = self.part.brought
        found = {self.motion.u: factor}
        return found if brought is None else {**found, brought: -factor}

    def _integral(self, end: float, start: float) -> dict:
        Δt = self.motion.dt
        return {**self._step(0.5 * end * Δt), self.part.U: end * Δt, self._sum: end + start}

    def _n(self, m: int | None, U: dict, total: dict) -> dict:
        """N_m; U itself where there is no third direction."""
        if m is None:
            return U
        return _sum((self._κ[m], U), (self._β[m], total))

    def _m(self, j: int, end: float, start: float) -> dict:
        """M_j."""
        κ, β, dim, H = self._κ, self._β, self.grid.dim, 0.5 * self.motion.dt
        k, m = (j + 1) % dim, (j + 2) % 3 if dim == 3 else None
        over = end / (κ[j] + β[j] * H)
        after, before = (
            self._n(m, self._displacement(*at), self._integral(*at)) for at in ((1, 0), (0, 1))
        )
        return _sum(
            (over * (κ[k] + β[k] * H), after),
            (-over * (κ[k] - β[k] * H), before),
            (over * (κ[j] - β[j] * H) + start, {self._fields[j]: 1.0}),
        )

    def _inertia(self, U: dict, total: dict, end: float, start: float):
        """Of p² ∏ (κ + β/p) U, by how many factors give β/p."""
        dim = self.grid.dim
        by = [0.0] * (dim + 1)
        for pick in digits(2, dim):
            product = 1.0
            for d in range(dim):
                product = product * (self._β[d] if pick[d] else self._κ[d])
            by[int(pick.sum())] += product
        velocity, acceleration = self._moving(end, start)
        found = by[0] * acceleration + by[1] * velocity + by[2] * _value(U)
        return found if dim == 2 else found + by[3] * _value(total)

    def _moving(self, end: float, start: float) -> tuple:
        """Velocity and acceleration: those in the balance, or sums of those at both ends of the
        step."""
        part = self.part
        moving = part.velocity, part.acceleration
        if (end, start) == (1.0, self.motion.stepping.start):
            return moving
        before = part.V, part.A
        return tuple(end * a + start * b for a, b in zip(moving, before, strict=True))

    def work_of_step(self, contribution: Contribution):
        """Work done on these cells in a step by those beside them, a form: that of the mean of the
        forces at its start and its end, with what was there at the start kept for it."""
        known = {f: f.copy() for f in self._kept()}
        u = self.motion.u

        def keep(*_) -> None:
            for f, kept in known.items():
                kept.x.array[:] = f.x.array

        contribution.before.append(keep)
        return ufl.replace(self.work(u, 0.5, 0.5), known)

    def history(self) -> list[fem.Function]:
        """The fields that their forces are linear in."""
        brought = self.part.brought
        return self._kept() if brought is None else [*self._kept(), brought]

    def _kept(self) -> list[fem.Function]:
        more = [self._sum] if self.grid.dim == 3 else []
        return [*self.part.history(), *self._fields, *more]

    def carry(self) -> None:
        """Take everything to the end of the step."""
        part, motion = self.part, self.motion
        H, on = 0.5 * motion.stepping.dt, part.nodes
        u, U, total = part.moved(), motion.nodal(part.U), motion.nodal(self._sum)
        stretch, cells = (self._kappa, self._beta), (part.cells, self._nodes)
        for j, (M, across) in enumerate(zip(self.M, self._across, strict=True)):
            _follow(j, (*cells, across), H, stretch, (u, U, total), M)
        if self.grid.dim == 3:
            total[on] += H * (2.0 * U[on] + u[on])
        part.carry()

    def memory(self) -> dict[str, np.ndarray]:
        """Arrays by name that the next step depends on, not copied."""
        found = {f"M{j}": M for j, M in enumerate(self.M)} | self.part.memory()
        return found if self.grid.dim == 2 else {**found, "sum": self._sum.x.array}

    def spread(self) -> dict[str, Spread]:
        """How they lie on the ranks."""
        of_cells = {f"M{j}": Spread.CELLS for j in range(self.grid.dim)}
        return dict.fromkeys(self.memory(), Spread.NODES) | of_cells


def _sum(*parts: tuple) -> dict:
    """Of sums of fields, each times a factor."""
    found: dict = {}
    for factor, fields in parts:
        for f, weight in fields.items():
            term = factor * weight
            found[f] = term if f not in found else found[f] + term
    return found


def _slope(fields: dict):
    return sum(factor * grad(f) for f, factor in fields.items())


def _value(fields: dict):
    return sum(factor * f for f, factor in fields.items())


def _everywhere(grid: Grid, part: PlainCells, values: np.ndarray, elsewhere: float) -> fem.Function:
    """A field of the cells, with one value in all others."""
    f = part.field(values - elsewhere)
    f.x.array[:] += elsewhere
    return f


def _rules(grid: Grid, part: PlainCells, across: np.ndarray) -> list[tuple]:
    """For each set of directions in which the midpoint rule is taken, a measure, and 1 where that
    is of its cells alone, else a field that is 1 in these and 0 in others."""
    found = []
    of = np.take_along_axis(across, _axes(grid), axis=1)  # by axes of the reference cell
    key = of @ (1 << np.arange(grid.dim))
    for number in range(1, 2**grid.dim):
        here = part.marks & (key == number)
        if not grid.comm.allreduce(int(here.any())):
            continue
        lines = [MIDPOINT if number >> d & 1 else GAUSS for d in range(grid.dim)]
        points = np.stack([a.ravel() for a in np.meshgrid(*lines, indexing="ij")], axis=1)
        rule = {
            "quadrature_rule": "custom",
            "quadrature_degree": 1 if len(points) == 1 else 3,
            "quadrature_points": points,
            "quadrature_weights": np.full(len(points), 1.0 / len(points)),
        }
        factor = 1.0 if dolfinx_versions.FORMS_FOLLOW else part.field(here.astype(float))
        found.append((factor, part.measure(rule, here)))
    return found


def _axes(grid: Grid) -> np.ndarray:
    """Direction in space (cells, dim) of each axis of the reference cell."""
    x = grid.mesh.geometry.x[dolfinx_versions.cell_vertices(grid.mesh)][..., : grid.dim]
    return np.stack(
        [np.abs(x[:, 1 << r] - x[:, 0]).argmax(axis=1) for r in range(grid.dim)], axis=1
    )


@jit
def _follow(j, where, H, stretch, motion, M):
    """M_j (cells, corner, component) at the end of a step of which half is H, less its mean along
    j, which nothing asks for, and which grows under a displacement that stays.

    ``where``: cells, the nodes of all cells, and what tells the numbers of corners across j;
    ``stretch``: κ and β (cells, dim); ``motion``: u of the step, U and ∫U dt before it
    (nodes, dim).
    """
    cells, nodes, across = where
    kappa, beta = stretch
    u, U, total = motion
    dim = u.shape[1]
    k, m = (j + 1) % dim, (j + 2) % 3
    for n in range(len(cells)):
        c = cells[n]
        κm, βm = (kappa[c, m], beta[c, m]) if dim == 3 else (1.0, 0.0)
        κj, βj, κk, βk = kappa[c, j], beta[c, j], kappa[c, k], beta[c, k]
        over = 0.5 / (κj + βj * H)
        keep = 2.0 * (κj - βj * H) * over
        ahead, behind = (κk + βk * H) * over, (κk - βk * H) * over
        for corner in range(nodes.shape[1]):
            if corner & across[n]:
                continue
            other = corner | across[n]
            i, o = nodes[c, corner], nodes[c, other]
            for e in range(dim):
                moved, by = U[i, e] - U[o, e], u[i, e] - u[o, e]
                summed = total[i, e] - total[o, e]
                before = κm * moved + βm * summed
                after = κm * (moved + by) + βm * (summed + H * (2.0 * moved + by))
                half = keep * M[c, corner, e] + ahead * after - behind * before
                M[c, corner, e], M[c, other, e] = half, -half
