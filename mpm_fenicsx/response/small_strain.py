"""What yielding takes off the elastic step, at the Gauss points.

The forms carry the elastic response to the increment u; here the rest of the law is added,

    S_g = Σ_p w_gp [σ(state_p; Δε_g) − σ_p − C_p : Δε_g],    D_g = Σ_p w_gp [∂σ/∂ε − C_p],

w_gp = Σ_i N_i(x_g) S*_ip W_p / m_i: the double mapping of eq. (7), applied to the constitutive law
itself instead of to its moduli.  Where nothing yields both are zero and the step is the linear one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from petsc4py import PETSc

from ..common import tensors
from ..common.ranks import together
from ..dynamics.motion import Motion
from ..grid.cell_means import CellMeans
from ..grid.gauss_points import GaussPoints
from ..mapping.double_mapping import add, pairs_of
from ..mapping.shape_functions import Stencil
from ..materials.material import Given, hooke
from ..points.material_points import MaterialPoints
from .cell_materials import CellMaterials, MaterialRows, put_together
from .response import Response
from .strain_fields import StrainForms, StrainMeans


class YieldingAtGaussPoints(Response):
    """The same as fields at the Gauss points: of strain there, or with volume changes cell by cell
    where there are ``means``."""

    def __init__(
        self,
        motion: Motion,
        gauss: GaussPoints,
        materials: Sequence,
        means: CellMeans | None = None,
    ):
        super().__init__(motion, materials)
        kind = StrainForms if means is None else partial(StrainMeans, means)
        self.gauss, self.summed = gauss, means is not None
        self.fields = kind(motion, gauss, self.symmetric)
        self.stress, self.tangent = self.fields.stress, self.fields.tangent
        self.work, self.stiffness = self.fields.work, self.fields.stiffness

    def clear(self) -> None:
        """Nothing yields."""
        super().clear()
        self.stress.rows[:] = self.tangent.rows[:] = 0.0

    def add_force(self, internal: np.ndarray) -> None:
        """Add what is no form to the internal force (dofs,), N."""
        self.fields.add_force(self.motion.nodal(self.motion.u), _by_nodes(internal, self.motion))

    def add_stiffness(self, A: PETSc.Mat, fixed: np.ndarray) -> None:
        """Add the derivative of that to the matrix."""
        self.fields.add_stiffness(A, fixed)


class YieldingPoints(YieldingAtGaussPoints):
    """The laws of material points, double-mapped.

    Each point is asked at every Gauss point that its support domain reaches.
    """

    def __init__(
        self,
        motion: Motion,
        gauss: GaussPoints,
        bodies: Sequence[MaterialPoints],
        stencils: Sequence[Stencil],
        means: CellMeans | None = None,
    ):
        self._bodies = [
            (body, stencil)
            for body, stencil in zip(bodies, stencils, strict=True)
            if not body.material.linear
        ]
        super().__init__(motion, gauss, [body.material for body, _ in self._bodies], means)
        self._pairs: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def place(self) -> None:
        """Find the pairs for the points where they are now."""
        self._pairs = [pairs_of(self.gauss, body, at) for body, at in self._bodies]

    def _respond(self, u: np.ndarray) -> None:
        strain, fields = self.fields.strain(u), self.fields
        with together(self.motion.grid.comm, Exception):
            for (body, _), (point, where, weight) in zip(self._bodies, self._pairs, strict=True):
                law, state = body.material, (body.stress, body.remembered, body.parameters)
                lame = law.kinematics.moduli(body)
                rows, stress, tangent = self._law(law, strain, state, where, point, lame)
                if len(rows):
                    self.active = True
                    at, part = where[rows], weight[rows]
                    add(at, part, fields.stress_rows(stress), self.stress.rows)
                    add(at, part, fields.tangent_rows(tangent), self.tangent.rows)
        self.stress.gather()
        self.tangent.gather()


class YieldingElements(YieldingAtGaussPoints):
    """The laws at the Gauss points of finite elements.

    These carry stress (points, components), Pa, at the start that which is given or none, and
    history (points, columns of the longest).
    """

    def __init__(
        self,
        motion: Motion,
        gauss: GaussPoints,
        materials: CellMaterials,
        means: CellMeans | None = None,
        stress: np.ndarray | None = None,
    ):
        super().__init__(motion, gauss, materials.materials, means)
        self.parts = materials.parts(gauss.digit.shape[1])
        self.state = np.zeros((len(gauss), tensors.components(motion.grid.dim)))
        if stress is not None:
            self.state[:] = stress
        self.size = gauss.size if any(law.length for law in materials.materials) else None
        self.history = first_history(motion.grid.comm, self.parts, self.state, self.size)
        # what the strain so far would give without yielding
        self._elastic = np.zeros_like(self.state)

    def clear(self) -> None:
        """Nothing yields in this step; what yielded before stays."""
        super().clear()
        beyond = (1.0 + self.motion.stepping.start) * (self.state - self._elastic)
        self.stress.rows[:] = self.fields.stress_rows(beyond)

    def _state(self, part: MaterialRows) -> tuple[np.ndarray, np.ndarray, Given]:
        """Stress, history and parameters of one material's Gauss points."""
        rows = part.rows
        return self.state[rows], part.columns(self.history)[rows], part.given(self.size, rows)

    def _respond(self, u: np.ndarray) -> None:
        strain, fields = self.fields.strain(u), self.fields
        with together(self.motion.grid.comm, Exception):
            for part in self.parts:
                law, every = part.material, part.count
                if law.linear:
                    continue
                state = self._state(part)
                own = law.moduli(*state)
                strange = not all(np.all(a == b) for a, b in zip(own, law.lame, strict=True))
                rows, stress, tangent = self._law(
                    law, strain[part.rows], state, every, every, law.lame, strange
                )
                if len(rows):
                    self.active = True
                    at = part.numbers[rows]
                    self.stress.rows[at] += fields.stress_rows(stress)
                    self.tangent.rows[at] += fields.tangent_rows(tangent)

    def memory(self) -> dict[str, np.ndarray]:
        """Arrays that a restart needs, not copied."""
        return {"stress": self.state, "history": self.history, "elastic": self._elastic}

    def carry(self) -> None:
        """State at the end of the step."""
        strain = self.fields.strain(self.motion.nodal(self.motion.u))

        def respond(part: MaterialRows) -> tuple[np.ndarray, ...]:
            law, mine = part.material, strain[part.rows]
            elastic = hooke(law.lame, mine, self._elastic[part.rows])
            return elastic, *law.respond(mine, *self._state(part))

        with together(self.motion.grid.comm, Exception):
            self._elastic, self.state, self.history = put_together(
                self.parts, respond, (self._elastic, self.state, self.history)
            )

    def energy(self, cells: int) -> dict[str, float]:
        """Strain energy and plastic work (J) of the first ``cells`` cells."""
        points = cells * self.gauss.digit.shape[1]
        return energies(self.parts, points, self.gauss.volume, self.state, self.history, self.size)


def _by_nodes(values: np.ndarray, motion: Motion) -> np.ndarray:
    """Values (dofs,) as (nodes, dim), a view."""
    return values.reshape(-1, motion.grid.dim)


def first_history(
    comm, parts: Sequence[MaterialRows], stress: np.ndarray, size: np.ndarray | None
) -> np.ndarray:
    """State variables (points, columns of the longest) at the start.  What a law refuses it refuses
    here, on all ranks."""
    history = np.zeros((len(stress), max(len(part.material.history) for part in parts)))
    with together(comm):
        for part in parts:
            law, rows, given = part.material, part.rows, part.given(size, part.rows)
            part.columns(history)[rows] = law.initial_history(stress[rows], given)
            state = part.columns(history)[rows]
            law.respond(np.zeros_like(stress[rows]), stress[rows], state, given)
    return history


def energies(
    parts: Sequence[MaterialRows],
    points: int,
    volume: np.ndarray,
    stress: np.ndarray,
    history: np.ndarray,
    size: np.ndarray | None,
) -> dict[str, float]:
    """Strain energy and, where a law is not linear, plastic work (J) of the first Gauss points.

    ``volume`` (m³), ``stress`` (Pa), ``history`` and ``size`` (m, or None) are those of all.
    """
    found = {"strain": 0.0}
    for part in parts:
        rows, law = part.first(points), part.material
        state = part.columns(history)[rows]
        found["strain"] += float(volume[rows] @ law.energy(stress[rows], state))
        if not law.linear:
            work = law.plastic_work(state, part.given(size, rows))
            found["plastic"] = found.get("plastic", 0.0) + float(volume[rows] @ work)
    return found
