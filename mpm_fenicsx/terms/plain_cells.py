"""Cells of the grid without material points, whose nodes keep a motion of their own.

A far field, and a layer that absorbs, are finite elements beside the material points.  They share
nodes with the cells that hold points and the displacement increment u there, so that the two move
together.  Velocity and acceleration are their own, at shared nodes too: what points deposit there
is a mean over a neighbourhood, smooth where these cells' is not, and a layer that is fed with it
reflects, and grows.

What they add to the matrix depends on the length of the step alone, and is assembled once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem

from ..common import tensors
from ..common.compiled import digits
from ..common.spread import Spread
from ..dynamics.motion import Motion
from ..grid import dolfinx_versions, weak_forms
from ..grid.grid import Grid
from ..mapping.tied_sides import TiedSides
from ..materials.material import hooke


class PlainCells:
    """Some cells of a grid, and the motion of their nodes.

    ``marks`` (cells,), bool: which; ``cells`` (n,) and ``nodes`` (m,) their numbers, ghosts
    included.  ``U`` (m), and in dynamics ``V`` (m/s) and ``A`` (m/s²), fields: displacement,
    velocity and acceleration before the step, zero at other nodes; ``velocity`` and
    ``acceleration`` are those in the balance of forces, expressions.

    What their term sets: ``heavy``, whether they are a body's, with a ``density``, ``λ`` and ``μ``
    that ``dx`` integrates, ``regions`` of it, each a material and where (cells,), bool, it is, and
    ``centre`` changes of volume where these go cell by cell; ``fair``, whether what points deposit
    at shared nodes counts these cells too; ``follows``, whether the grid moves with the material
    points beside them.
    """

    heavy = fair = follows = False
    brought: fem.Function | None = None
    density: object = None
    λ: object = None
    μ: object = None
    regions: Sequence[tuple[object, np.ndarray]] = ()
    dx: ufl.Measure | None = None
    centre: ufl.Measure | None = None

    def __init__(
        self,
        grid: Grid,
        motion: Motion,
        marks: np.ndarray,
        owner: str,
        sides: TiedSides | None = None,
    ):
        self._sides = sides
        self.grid, self.motion, self.marks, self.owner = grid, motion, marks, owner
        self.cells = np.flatnonzero(marks).astype(np.int32)
        self.nodes = np.unique(dolfinx_versions.cell_dofs(grid.space)[self.cells])
        self.U = fem.Function(grid.space, name="displacement")
        self._moving = motion.stepping.dynamic
        if self._moving:
            self.V, self.A = (fem.Function(grid.space) for _ in range(2))
            self.velocity, self.acceleration = motion.balanced(self.V, self.A)

    def bring(self) -> None:
        """A motion comes in where these cells end: their own displacement is the increment u less
        ``brought``, a field that is zero at other nodes."""
        self.brought = fem.Function(self.grid.space)
        self.velocity, self.acceleration = self.motion.balanced(self.V, self.A, self.increment)

    @property
    def increment(self):
        """Their displacement in the step, an expression."""
        u = self.motion.u
        return u if self.brought is None else u - self.brought

    def moved(self) -> np.ndarray:
        """Their displacement (nodes, dim), m, in the step that was solved."""
        u = self.motion.nodal(self.motion.u)
        return u if self.brought is None else u - self.motion.nodal(self.brought)

    def measure(self, metadata: Mapping[str, object], marks: np.ndarray | None = None):
        """Measure of these cells, or of some of them, ``marks`` (cells,).

        In DOLFINx 0.5 it is that of all cells: multiply by a field that is zero in others
        (``field``).
        """
        dx, cover = self.motion.region.some(metadata)
        cover(self.cells if marks is None else np.flatnonzero(marks).astype(np.int32))
        return dx

    def field(self, values: np.ndarray | float) -> fem.Function:
        """A field of the cells, from ``values`` (cells,) or one value, zero in all other cells."""
        f = fem.Function(dolfinx_versions.space(self.grid.mesh, "DQ", 0))
        dofs = dolfinx_versions.cell_dofs(f.function_space)[:, 0]
        f.x.array[dofs] = np.where(self.marks, values, 0.0)
        return f

    def of_material(self, material) -> tuple | None:
        """ρ, λ and μ, fields, with those of all other materials left out; all of them, if None is
        asked for.  None where there is nothing of the material.  Collective."""
        fields = self.density, self.λ, self.μ
        if material is None:
            return fields
        here = np.zeros(self.grid.cells, dtype=bool)
        for law, where in self.regions:
            here |= where & self.marks & (law == material)
        if not self.grid.comm.allreduce(int(here[: self.grid.owned_cells].any())):
            return None
        dofs = dolfinx_versions.cell_dofs(self.λ.function_space)[:, 0]
        return tuple(self.field(np.where(here, f.x.array[dofs], 0.0)) for f in fields)

    def elastic_work(self, u, w):
        """Virtual work of the elastic stress of u in these cells against w, a form."""
        return weak_forms.elastic_work(self.λ, self.μ, u, w, self.dx, self.centre)

    def stress(self, cells: np.ndarray, strain: np.ndarray) -> np.ndarray:
        """Stress rows (n, components), Pa, of a strain (n, components) in some of these cells."""
        dofs = dolfinx_versions.cell_dofs(self.λ.function_space)[cells, 0]
        lame = tuple(f.x.array[dofs] for f in (self.λ, self.μ))
        return hooke(lame, strain, np.zeros_like(strain))

    @cached_property
    def inside(self) -> fem.Function:
        """1 in these cells, 0 in others."""
        return self.field(1.0)

    @cached_property
    def lumped(self) -> np.ndarray:
        """Mass (nodes,), kg, lumped."""
        f = fem.Function(self.grid.space)
        form = self.density * ufl.TestFunction(self.grid.space)[0] * self.dx
        dolfinx_versions.assemble_vector(f, dolfinx_versions.compile_form(form))
        dolfinx_versions.gather(f)
        return self.motion.nodal(f)[:, 0].copy()

    @cached_property
    def shared(self) -> np.ndarray:
        """Nodes (n,) that these cells share with others of the grid."""
        others = np.zeros(self.grid.nodes, dtype=bool)
        others[dolfinx_versions.cell_dofs(self.grid.space)[~self.marks]] = True
        if self._sides is not None:
            others = self._sides.largest(others)
        return np.intersect1d(self.nodes, np.flatnonzero(others))

    @cached_property
    def own(self) -> np.ndarray:
        """Nodes (n,) of these cells alone."""
        return np.setdiff1d(self.nodes, self.shared)

    @cached_property
    def edge_dx(self) -> ufl.Measure:
        """Measure of those cells that have shared nodes."""
        nodes = dolfinx_versions.cell_dofs(self.grid.space)
        at_edge = self.marks & np.isin(nodes, self.shared).any(axis=1)
        return self.measure({"quadrature_degree": 3}, at_edge)

    @cached_property
    def _energies(self) -> dict[str, list]:
        forms = {"strain": 0.5 * self.elastic_work(self.U, self.U)}
        if self._moving:
            forms["kinetic"] = 0.5 * self.density * ufl.inner(self.V, self.V) * self.dx
        return {name: dolfinx_versions.compile_form(form) for name, form in forms.items()}

    def energy(self) -> dict[str, float]:
        """Strain and kinetic energy (J) of this rank's own of these cells, where they are a body's:
        ``heavy``."""
        if not self.heavy:
            return {}
        return {k: dolfinx_versions.assemble_scalar(form) for k, form in self._energies.items()}

    def count(self) -> int:
        """Number of the cells, of all ranks.  Collective."""
        return self.grid.comm.allreduce(int(self.marks[: self.grid.owned_cells].sum()))

    def go_on_from(self, before: PlainCells) -> None:
        """Take over displacement and, where both move, velocity and acceleration."""
        self.U.x.array[:] = before.U.x.array
        if self._moving and before._moving:
            self.V.x.array[:], self.A.x.array[:] = before.V.x.array, before.A.x.array

    def trim(self) -> None:
        """Forget the motion of nodes that belong to none of these cells."""
        others = np.ones(self.grid.nodes, dtype=bool)
        others[self.nodes] = False
        for f in self.history():
            self.motion.nodal(f)[others] = 0.0

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes of this rank's own of these cells (cells, 2^dim), and ∂N/∂x of each at their
        centres (cells, 2^dim, dim), 1/m."""
        grid = self.grid
        own = self.cells[self.cells < grid.owned_cells]
        slope = (2 * digits(2, grid.dim) - 1) / 2 ** (grid.dim - 1)  # ∂N/∂ξ
        x = grid.made_at[dolfinx_versions.cell_vertices(grid.mesh)[own]]
        inverse = np.linalg.inv(np.einsum("cki,kj->cij", x, slope))
        nodes = dolfinx_versions.cell_dofs(grid.space)[own]
        return nodes, np.einsum("kj,cji->cki", slope, inverse)

    def largest_strain(self) -> float:
        """The largest difference of principal strains (-), at the centres of the cells.
        Collective."""
        nodes, slopes = self._slopes
        gradient = np.einsum("cki,ckj->cij", self.motion.nodal(self.U)[nodes], slopes)
        strain = 0.5 * (gradient + gradient.transpose(0, 2, 1))
        if self.grid.dim == 3:
            largest = np.ptp(np.linalg.eigvalsh(strain), axis=1)
        else:  # the third principal strain is zero
            mean = 0.5 * (strain[:, 0, 0] + strain[:, 1, 1])
            radius = np.hypot(0.5 * (strain[:, 0, 0] - strain[:, 1, 1]), strain[:, 0, 1])
            largest = np.maximum(2.0 * radius, np.abs(mean) + radius)
        return self.grid.comm.allreduce(float(largest.max(initial=0.0)), op=MPI.MAX)

    def samples(self, field: str) -> tuple[np.ndarray, np.ndarray]:
        """Places (n, dim), m, where this rank knows a field of its own cells, and their numbers
        (n,): nodes, and for stress centres of cells."""
        grid = self.grid
        if field == "stress":
            own = self.cells[self.cells < grid.owned_cells]
            return grid.centres[own] + grid.offset, grid.cell_numbers[own]
        own = self.nodes[self.nodes < grid.space.dofmap.index_map.size_local]
        return grid.space.tabulate_dof_coordinates()[own, : grid.dim], grid.node_numbers[own]

    def values(self, field: str, rows: np.ndarray) -> np.ndarray:
        """Displacement (m), velocity (m/s), acceleration (m/s²) or stress (Pa) of some rows of
        ``samples``, in statics that of the first and last alone."""
        if field == "stress":
            nodes, slopes = self._slopes
            gradient = np.einsum(
                "cki,ckj->cij", self.motion.nodal(self.U)[nodes[rows]], slopes[rows]
            )
            own = self.cells[self.cells < self.grid.owned_cells]
            return self.stress(own[rows], tensors.strain(gradient))
        own = self.nodes[self.nodes < self.grid.space.dofmap.index_map.size_local]
        fields = {"displacement": self.U}
        if self._moving:
            fields |= {"velocity": self.V, "acceleration": self.A}
        return self.motion.nodal(fields[field])[own[rows]]

    def start_with(self, acceleration: np.ndarray) -> None:
        """Take nodal accelerations (nodes, dim), m/s², at the start."""
        self.motion.nodal(self.A)[self.nodes] = acceleration[self.nodes]

    def know_start(self) -> None:
        """Where motion is known, take it as it is before the step."""
        if self._moving and self.brought is None:
            self.motion.know_start(self.motion.nodal(self.V), self.motion.nodal(self.A))

    def carry(self) -> None:
        """Displacement, velocity and acceleration at the end of the step."""
        motion = self.motion
        moved = self.moved()
        motion.nodal(self.U)[self.nodes] += moved[self.nodes]
        if self._moving:
            motion.advance(self.nodes, moved, self.V, self.A, known=self.brought is None)

    def memory(self) -> dict[str, np.ndarray]:
        """Arrays by name that the next step depends on, not copied."""
        fields = {"U": self.U}
        if self._moving:
            fields |= {"V": self.V, "A": self.A}
        return {name: f.x.array for name, f in fields.items()}

    def history(self) -> list[fem.Function]:
        """The fields that their forces are linear in."""
        return [self.U, self.V, self.A] if self._moving else [self.U]

    def spread(self) -> dict[str, Spread]:
        """They lie on nodes."""
        return dict.fromkeys(self.memory(), Spread.NODES)


def mixed_velocity(motion: Motion, plain: list[PlainCells]):
    """Velocity in the balance of forces as each cell has it: that of plain cells, and elsewhere
    the motion's."""
    if not plain:
        return motion.velocity
    elsewhere = 1.0 - sum(part.inside for part in plain)
    return elsewhere * motion.velocity + sum(part.inside * part.velocity for part in plain)
