"""Small cuts: what a cell holds too little of is held by the cells beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem

from ..common.checks import finite, positive
from ..common.spread import Spread
from ..grid import dolfinx_versions, weak_forms
from ..grid.grid import Grid
from ..mapping.projection import HATS, QUADRATICS
from .contribution import Contribution
from .scene import Scene

# of a full cell: with less, nodal velocities are round-off (GIMP's), and stiffness alone holds
# nodes
TRACE = 1e-6


@dataclass(frozen=True)
class GhostPenalty:
    """Light nodes follow the motion of the cells beside them (Burman 2010; for waves Sticko &
    Kreiss 2019; for material points Coombs 2023).

    On each facet between a cell with light nodes and another one with material, h the cells' size
    across it,

        β (γ_K (λ + 2μ) h [∂u/∂n]·[∂w/∂n] + γ_M ρ h³ [∂a/∂n]·[∂w/∂n]),

    γ_K ``stiffness`` and γ_M ``mass`` (-), with the moduli and density of cells when full. Motions
    linear in x have no jump: they do not feel it, and linear and angular momentum are as without
    it. Of u it is the increment of the
    step that counts, so that nothing is left of it in equilibrium (``settle``; but what pulls at a
    node that the body reaches by a hair, steps do not balance: docs/limits.md).  A node is light
    where no cell around gives it the part ``below`` of what a full cell gives; β goes from 0 there
    to 1 where there is nothing.  ``mass`` plays no part in statics. A finite element run, where
    cells are full, adds nothing.
    Raises ``ValueError`` for numbers < 0, or ``below`` out of (0, 1].
    """

    stiffness: float = 0.03
    mass: float = 0.1
    below: float = 0.5

    def __post_init__(self) -> None:
        for name in ("stiffness", "mass"):
            if finite(name, getattr(self, name)) < 0.0:
                raise ValueError(f"{name} must be >= 0, got {getattr(self, name)}")
        if positive("below", self.below) > 1.0:
            raise ValueError(f"below must be at most 1, got {self.below}")

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work of the jumps."""
        if not scene.partly_filled:
            return Contribution()
        motion, grid = scene.motion, scene.grid
        region = motion.region
        measure = region.seams()(metadata={"quadrature_degree": 3})
        loaded = np.zeros(grid.cells, np.int8)
        cut = _Cut(grid, scene.density, scene.lame, self.below)

        def refresh(start: float, end: float) -> None:
            loaded[:] = 0
            scene.mark(loaded)
            cut.find(loaded)
            region.sew(cut.light, cut.filled)

        n, J = ufl.FacetNormal(grid.mesh), ufl.Jacobian(grid.mesh)
        h = ufl.avg(weak_forms.across(J, n))
        β = ufl.max_value(cut.β("+"), cut.β("-"))
        M, ρ = (ufl.min_value(f("+"), f("-")) for f in (cut.modulus, cut.density))
        work = weak_forms.kink(self.stiffness * β * M * h, motion.u, motion.w, n)
        if motion.stepping.dynamic:
            work += weak_forms.kink(self.mass * β * ρ * h**3, motion.acceleration, motion.w, n)
        memory = {"places": region.places} if region.follows else {}
        return Contribution(
            work * measure,
            before=[refresh],
            memory=memory,
            spread=dict.fromkeys(memory, Spread.CELLS),
        )


class CellWeights:
    """What a discontinuous field gives to the nodes of each cell: 2^dim ∫ f N over |c|, 1 to each
    of a field of 1."""

    def __init__(self, grid: Grid, f: fem.Function):
        nodes = round(dolfinx_versions.cell_dofs(f.function_space).shape[1] ** (1 / grid.dim))
        self._field, self._dofs = f, grid.tensor_order(f.function_space, nodes - 1)
        g = HATS if nodes == 2 else QUADRATICS
        line = 2.0 * g @ (1.0 / (np.arange(nodes)[:, None] + np.arange(2) + 1.0)) @ HATS.T
        self._weights = line
        for _ in range(grid.dim - 1):
            self._weights = np.kron(self._weights, line)

    def to_nodes(self) -> np.ndarray:
        """To each node (cells, 2^dim)."""
        return self._field.x.array[self._dofs] @ self._weights

    def mean(self) -> np.ndarray:
        """The field's means (cells,)."""
        return self._field.x.array[self._dofs] @ self._weights.mean(axis=1)


class _Cut:
    """Which cells have light nodes, ``β`` how light; ``modulus`` (Pa) and ``density`` (kg/m³) of
    cells when full, zero where there is nothing."""

    def __init__(self, grid: Grid, density: fem.Function, lame: tuple, below: float):
        self.grid, self.below = grid, below
        self._density, *self._lame = (CellWeights(grid, f) for f in (density, *lame))
        W = dolfinx_versions.space(grid.mesh, "DQ", 0)
        self._of_cells = dolfinx_versions.cell_dofs(W)[:, 0]
        self.β, self.modulus, self.density = (fem.Function(W) for _ in range(3))

    def find(self, filled: np.ndarray) -> None:
        """Look at the fields as they are; cells in ``filled`` (cells,) bear a load though they may
        be empty."""
        grid, lattice = self.grid, self.grid.lattice
        mean = np.maximum(self._density.mean(), 0.0)
        full = grid.share_cells(lattice.spread(mean))
        there = mean > TRACE * full
        self.filled = (mean > 0.0) | grid.marked_anywhere(filled)
        self._set(self.density, np.where(there, full, 0.0))
        λ, μ = (f.mean() for f in self._lame)
        speed = np.maximum(λ + 2.0 * μ, 0.0) / np.where(there, mean, 1.0)  # c_p², however full
        self._set(
            self.modulus,
            np.where(self.filled, full * np.where(there, speed, lattice.spread(speed)), 0.0),
        )
        given = np.maximum(self._density.to_nodes(), 0.0) / np.where(full > 0.0, full, 1.0)[:, None]
        best = np.zeros(grid.nodes)
        np.maximum.at(best, lattice.nodes, given)
        lacking = np.maximum(1.0 - best[lattice.nodes].min(axis=1) / self.below, 0.0)
        self.light = self._set(self.β, np.where(self.filled, lacking, 0.0)) > 0.0

    def _set(self, f: fem.Function, values: np.ndarray) -> np.ndarray:
        """The field becomes values (cells,), and ghost cells their owners'; returns them."""
        f.x.array[self._of_cells] = values
        dolfinx_versions.share(f)
        return f.x.array[self._of_cells]
