"""What yielding takes off the elastic step, at the Gauss points.

The forms carry the elastic response to the increment u; here the rest of the law is added,

    S_g = Σ_p w_gp [σ(state_p; Δε_g) − σ_p − C_p : Δε_g],    D_g = Σ_p w_gp [∂σ/∂ε − C_p],

w_gp = Σ_i N_i(x_g) S*_ip W_p / m_i: the double mapping of eq. (7), applied to the constitutive law itself instead of
to its moduli.  Where nothing yields both are zero and the step is the linear one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import ufl

from . import forms, tensors
from .cell_materials import CellMaterials, MaterialRows, put_together
from .gauss import GaussField, GaussPoints, measure
from .kernels import digits, jit
from .motion import Motion
from .partition import together
from .points import MaterialPoints
from .projection import DOUBLE_MAPPED
from .shapes import Stencil

PLACE = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)  # of the Gauss points along a direction


@jit
def _count(side):
    """Cells that each point's support domain touches, all together."""
    total = 0
    for p in range(len(side)):
        cells = 1
        for d in range(side.shape[1]):
            cells *= 2 if side[p, d] != 0 else 1
        total += cells
    return total


@jit
def _pair(side, span, share, cell, volume, neighbour, dual, place, digit, corners, cell_volume, point, gauss, weight):
    """Pairs of a point and a Gauss point that it reaches, with w_gp |c|-weighted; returns their number.

    ``place`` (2,) reference coordinates of the Gauss points along a direction, ``dual`` as in ``Projection``.
    """
    n, dim = side.shape
    line = np.empty((dim, 2, 2))
    m = 0
    for p in range(n):
        crossed = 0
        for d in range(dim):
            crossed += side[p, d] != 0
            for s in range(2):
                mean = 0.5 * (span[p, d, s, 0] + span[p, d, s, 1])
                low = dual[0, 0] + dual[0, 1] * mean
                high = dual[1, 0] + dual[1, 1] * mean
                for b in range(2):
                    line[d, s, b] = share[p, d, s] * ((1 - place[b]) * low + place[b] * high)
        for k in range(len(corners) if crossed else 1):
            c = cell[p]
            for d in range(dim):
                if corners[k, d]:
                    c = neighbour[c, d, (side[p, d] + 1) // 2] if side[p, d] != 0 and c >= 0 else -1
            if c < 0:
                continue
            for q in range(digit.shape[1]):
                w = volume[p] / cell_volume[c]
                for d in range(dim):
                    w *= line[d, corners[k, d], digit[c, q, d]]
                if w > 0.0:
                    point[m], gauss[m], weight[m] = p, c * digit.shape[1] + q, w
                    m += 1
    return m


@jit
def add(gauss, weight, values, out):
    """out_g += w q for the pairs' values (m, f)."""
    for m in range(len(gauss)):
        for f in range(values.shape[1]):
            out[gauss[m], f] += weight[m] * values[m, f]


def pairs_of(gauss: GaussPoints, body: MaterialPoints, at: Stencil) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (m,), Gauss points that they reach (m,) and w_gp (m,), for the points where they are now."""
    lat = gauss.grid.lattice
    most = _count(at.side) * gauss.digit.shape[1]
    point, where, weight = np.empty(most, np.int32), np.empty(most, np.int32), np.empty(most)
    found = _pair(at.side, at.span, at.share, at.cell, body.volume, lat.neighbour, DOUBLE_MAPPED.dual, PLACE,
                  gauss.digit, digits(2, gauss.grid.dim), lat.volume, point, where, weight)
    return point[:found], where[:found], weight[:found]


class Yielding:
    """What the law adds to the elastic response: ``work`` and ``stiffness`` as forms, or a force summed at points."""

    work: object = 0
    stiffness: object = 0

    def __init__(self, motion: Motion):
        self.motion = motion
        self._plane = tensors.in_plane(motion.grid.dim)
        self._upper = np.triu_indices(len(self._plane))
        self.active = False

    def clear(self) -> None:
        """Nothing yields."""
        self.active = False

    def evaluate(self) -> bool:
        """Refresh everything for the motion's u; True where anything yields on any rank."""
        self.clear()
        self._respond(self.motion.nodal(self.motion.u))
        self.active = bool(self.motion.grid.comm.allreduce(int(self.active)))
        return self.active

    def add_force(self, internal: np.ndarray) -> None:
        """Add what is no form to the internal force (dofs,), N."""

    def inspect(self) -> None:
        """Raise ``ValueError`` where the step that is solved cannot be carried."""

    def memory(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied; material points carry their own."""
        return {}

    def take(self, other: Yielding) -> None:
        """Go on from another run's state."""
        mine = self.memory()
        for name, value in other.memory().items():
            mine[name][:] = value
        self.derive()

    def derive(self) -> None:
        """Refresh what follows from the memory."""

    def _respond(self, u: np.ndarray) -> None:
        raise NotImplementedError

    def _law(self, material, strain, state, at, of) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which pairs of strain ``at`` and state ``of`` yield; beyond elasticity their stress, and their tangent in
        the plane."""
        stress, history, size = state
        rows = material.yields(strain, stress, history, at, of, size)
        at, of = at[rows], of[rows]
        ε, σ = strain[at], stress[of]
        new, _, tangent = material.tangent(ε, σ, history[of], None if size is None else size[of])
        i, j = self._upper
        elastic = material.elastic.tangent(ε[:1], σ[:1], None)[2]
        return rows, new - material.elastic.update(ε, σ), (tangent - elastic)[:, self._plane[i], self._plane[j]]


class YieldingAtGaussPoints(Yielding):
    """The same as fields at the Gauss points."""

    def __init__(self, motion: Motion, gauss: GaussPoints):
        super().__init__(motion)
        self.gauss, grid = gauss, motion.grid
        self.stress = GaussField(grid, len(self._plane))
        self.tangent = GaussField(grid, len(self._upper[0]))
        dx, trial = measure(motion.region.dx), ufl.TrialFunction(grid.space)
        self.work = forms.plastic_work(self.stress.function, motion.w) * dx
        self.stiffness = forms.plastic_stiffness(self.tangent.function, trial, motion.w) * dx

    def clear(self) -> None:
        """Nothing yields."""
        super().clear()
        self.stress.rows[:] = self.tangent.rows[:] = 0.0


class YieldingPoints(YieldingAtGaussPoints):
    """The laws of material points, double-mapped.

    Each point is asked at every Gauss point that its support domain reaches.
    """

    def __init__(self, motion: Motion, gauss: GaussPoints, bodies: Sequence[MaterialPoints],
                 stencils: Sequence[Stencil]):
        super().__init__(motion, gauss)
        self._bodies = [(body, stencil) for body, stencil in zip(bodies, stencils, strict=True)
                        if body.material.history]
        self._pairs: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def place(self) -> None:
        """Find the pairs for the points where they are now."""
        self._pairs = [pairs_of(self.gauss, body, at) for body, at in self._bodies]

    def _respond(self, u: np.ndarray) -> None:
        strain = self.gauss.strain(u)
        for (body, _), (point, where, weight) in zip(self._bodies, self._pairs, strict=True):
            state = body.stress, body.history, body.size
            rows, stress, tangent = self._law(body.material, strain, state, where, point)
            if len(rows):
                self.active = True
                add(where[rows], weight[rows], stress[:, self._plane], self.stress.rows)
                add(where[rows], weight[rows], tangent, self.tangent.rows)
        self.stress.gather()
        self.tangent.gather()


class YieldingElements(YieldingAtGaussPoints):
    """The laws at the Gauss points of finite elements.

    These carry stress (points, components), Pa, and history (points, columns of the longest).
    """

    def __init__(self, motion: Motion, gauss: GaussPoints, materials: CellMaterials):
        super().__init__(motion, gauss)
        self.parts = materials.parts(gauss.digit.shape[1])
        self.state = np.zeros((len(gauss), tensors.components(motion.grid.dim)))
        self.history = np.zeros((len(gauss), max(len(law.history) for law in materials.materials)))
        self.size = gauss.size if any(law.length for law in materials.materials) else None
        with together(motion.grid.comm):  # what a law refuses it refuses here, on all ranks
            for part in self.parts:
                stress, history, size = self._state(part)
                part.material.respond(np.zeros_like(stress), stress, history, size)
        self._elastic = np.zeros_like(self.state)  # what the strain so far would give without yielding

    def clear(self) -> None:
        """Nothing yields in this step; what yielded before stays."""
        super().clear()
        self.stress.rows[:] = (1.0 + self.motion.stepping.start) * (self.state - self._elastic)[:, self._plane]

    def _state(self, part: MaterialRows) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Stress, history and sizes of one material's Gauss points."""
        rows, size = part.rows, part.size(self.size)
        size = None if size is None else size[rows]
        return self.state[rows], part.columns(self.history)[rows], size

    def _respond(self, u: np.ndarray) -> None:
        strain = self.gauss.strain(u)
        for part in self.parts:
            if not part.material.history:
                continue
            rows, stress, tangent = self._law(part.material, strain[part.rows], self._state(part),
                                              part.count, part.count)
            if len(rows):
                self.active = True
                at = part.numbers[rows]
                self.stress.rows[at] += stress[:, self._plane]
                self.tangent.rows[at] += tangent

    def memory(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        return {"stress": self.state, "history": self.history, "elastic": self._elastic}

    def carry(self) -> None:
        """State at the end of the step."""
        strain = self.gauss.strain(self.motion.nodal(self.motion.u))

        def respond(part: MaterialRows) -> tuple[np.ndarray, ...]:
            law, mine = part.material, strain[part.rows]
            stress, history, size = self._state(part)
            elastic = getattr(law, "elastic", law).update(mine, self._elastic[part.rows])
            return elastic, *law.respond(mine, stress, history, size)

        self._elastic, self.state, self.history = put_together(
            self.parts, respond, (self._elastic, self.state, self.history))

    def energy(self, cells: int) -> dict[str, float]:
        """Strain energy and plastic work (J) of the first ``cells`` cells."""
        points = cells * self.gauss.digit.shape[1]
        return energies(self.parts, points, self.gauss.volume, self.state, self.history, self.size)


def energies(parts: Sequence[MaterialRows], points: int, volume: np.ndarray, stress: np.ndarray,
             history: np.ndarray, size: np.ndarray | None) -> dict[str, float]:
    """Strain energy and, where a law can yield, plastic work (J) of the first Gauss points.

    ``volume`` (m³), ``stress`` (Pa), ``history`` and ``size`` (m, or None) are those of all.
    """
    found = {"strain": 0.0}
    for part in parts:
        rows, law, d = part.first(points), part.material, part.size(size)
        found["strain"] += float(volume[rows] @ law.energy(stress[rows]))
        if law.history:
            work = law.plastic_work(part.columns(history)[rows], None if d is None else d[rows])
            found["plastic"] = found.get("plastic", 0.0) + float(volume[rows] @ work)
    return found
