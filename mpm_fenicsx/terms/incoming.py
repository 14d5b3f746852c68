"""A motion that comes in from outside, as absorbing boundaries are told of it.

Where a motion u_in comes in, a boundary that absorbs has to do so with the rest, u − u_in, and to
bear the traction of what comes in besides:

    dashpots and springs:  t = σ_in n − Z (v − v_in) − k (u − u_in),
    cells of a layer:      R(u − u_in) + R_in,

R their forces, and R_in those of cells of ordinary ground in the place of the layer's innermost,
at the nodes shared with the body (domain reduction: Bielak, Loukakis, Hisada & Yoshimura, Bull.
Seism. Soc. Am. 93, 817-824, 2003).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np
from dolfinx import fem
from ufl import TestFunction, inner

from ..common import tensors
from ..common.compiled import digits
from ..common.ranks import warn
from ..grid import dolfinx_versions, weak_forms
from ..grid.grid import GridSurface
from .absorbing import ViscousBoundary
from .contribution import Contribution
from .facets import each_facet
from .load_functions import Load
from .loads import Surface
from .plain_cells import PlainCells
from .scene import Scene


class Incoming(Protocol):
    """What comes in: functions of time t (s) and places x (n, dim), m."""

    def displacement(self, t: float, x: np.ndarray) -> np.ndarray:
        """Displacement (n, dim), m."""

    def velocity(self, t: float, x: np.ndarray) -> np.ndarray:
        """Velocity (n, dim), m/s."""

    def acceleration(self, t: float, x: np.ndarray) -> np.ndarray:
        """Acceleration (n, dim), m/s²."""

    def stress(self, t: float, x: np.ndarray) -> np.ndarray:
        """Stress rows (n, components), Pa."""


def boundaries_on(scene: Scene, name: str, on: Surface) -> list[tuple[Surface, list]]:
    """The parts of a surface, and the dashpots and springs that act on each.

    Raises ``ValueError`` where a part has none.
    """
    terms = [term for term in scene.terms if isinstance(term, ViscousBoundary)]
    if not isinstance(on, GridSurface):
        found = [(on, [term for term in terms if term.on is on])]
    else:
        of = {tag: [t for t in terms if tag in getattr(t.on, "tags", ())] for tag in on.tags}
        groups: dict[tuple, list[int]] = {}
        for tag, acting in of.items():
            groups.setdefault(tuple(map(id, acting)), []).append(tag)
        found = [
            (on if len(groups) == 1 else replace(on, tags=tuple(tags)), of[tags[0]])
            for tags in groups.values()
        ]
    if not all(acting for _, acting in found):
        raise ValueError(
            f"on: nothing absorbs where {name} comes in, or on a part of it, so that all that goes "
            "out would come back: add ViscousBoundary(on, material) on the same facets, or on the "
            "same surface points"
        )
    if isinstance(on, GridSurface):
        _warn_of_empty_cells(scene, name, on)
    return found


def _warn_of_empty_cells(scene: Scene, name: str, on: GridSurface) -> None:
    """Warn of facets that end beyond the material, whose loads act on its last nodes."""
    comm, held = scene.grid.comm, _held(scene)
    facets = [held[nodes].all() for nodes, _ in each_facet(scene.grid, on)]
    empty, count = comm.allreduce(facets.count(False)), comm.allreduce(len(facets))
    if empty:
        warn(
            comm,
            f"on: {name} acts on {count} facets, of which {empty} are beside cells without "
            "material: what is borne there acts on the nodes where the material ends; let the "
            "facets end with it (Grid.box(..., facets=))",
            4,
        )


def _held(scene: Scene) -> np.ndarray:
    """Which nodes (nodes,) belong to cells with material."""
    held = np.zeros(scene.grid.nodes, dtype=bool)
    held[dolfinx_versions.cell_dofs(scene.grid.space)[scene.filled()]] = True
    return held


def into_boundaries(
    scene: Scene, name: str, boundaries: list[tuple[Surface, list]], incoming: Incoming
) -> Contribution:
    """What comes in where dashpots and springs act: surfaces, and the terms on each."""
    parts = [_into(scene, name, on, acting, incoming) for on, acting in boundaries]
    work = sum(traction() for traction, _ in parts)
    return Contribution(
        work, force=work, energy=lambda: {"work": sum(energy() for _, energy in parts)}
    )


def _into(
    scene: Scene, name: str, on: Surface, acting: list[ViscousBoundary], incoming: Incoming
) -> tuple[Callable, Callable]:
    """The virtual work on one surface, and the work done in a step."""
    patch, motion, dim = scene.patch(on), scene.motion, scene.grid.dim

    def load(function: Callable[[float, np.ndarray], np.ndarray], numbers: int = dim) -> Load:
        scene.loads.append(Load(f"motion of {name}", function, numbers))
        return scene.loads[-1]

    stress = load(incoming.stress, tensors.components(dim))
    velocity, displacement = load(incoming.velocity), load(incoming.displacement)
    impedance = np.sum([boundary.impedance for boundary in acting], axis=0)
    stiffness = np.sum([boundary.stiffness for boundary in acting], axis=0)

    def traction(mean: bool = False):
        found = patch.traction(stress, mean) + patch.times(*impedance, velocity, mean)
        return found + patch.times(*stiffness, displacement, mean) if stiffness.any() else found

    return (
        lambda: -weak_forms.load(traction(), motion.w) * patch.measure,
        lambda: weak_forms.load(traction(mean=True), motion.u) * patch.measure,
    )


class IntoLayer:
    """What comes in at the nodes (n,) that the cells of a layer share with the body.

    ``brought``: its increment of the step at these nodes, which the layer's displacement is less
    by.
    """

    def __init__(self, scene: Scene, name: str, part: PlainCells, incoming: Incoming):
        self.scene, self.part, self.incoming = scene, part, incoming
        grid = self.grid = scene.grid
        self._load = Load(f"motion of {name}", lambda t, x: incoming.displacement(t, x), grid.dim)
        scene.loads.append(self._load)
        self.brought = part.brought
        self._damps = hasattr(incoming, "damping") and bool(incoming.damping(grid.centres).any())
        self._x = grid.space.tabulate_dof_coordinates()[:, : grid.dim]
        nodes = dolfinx_versions.cell_dofs(grid.space)
        self._asked = False  # for the work done
        self._edge = part.marks & np.isin(nodes, part.shared).any(axis=1)
        self._nodes = np.unique(nodes[self._edge])

    def bind(self) -> Contribution:
        """Forces at the shared nodes, and the increment that the layer does not bear."""
        grid, motion, part = self.grid, self.scene.motion, self.part
        self._u, self._a, self._force, self._mean = (fem.Function(grid.space) for _ in range(4))
        w, dx = TestFunction(grid.space), part.edge_dx
        forces = weak_forms.internal_work(
            weak_forms.hooke(part.λ, part.μ, weak_forms.strain(self._u)), w
        )
        forces += weak_forms.inertia(part.density, self._a, w)
        if self._damps:
            forces += self._damping(w)
        self._form = dolfinx_versions.compile_form(forces * dx)
        self._sum = fem.Function(grid.space)
        corners = digits(2, grid.dim).astype(float)
        at_corners = part.measure(
            {
                "quadrature_rule": "custom",
                "quadrature_degree": 1,
                "quadrature_points": corners,
                "quadrature_weights": np.full(len(corners), 1.0 / len(corners)),
            },
            self._edge,
        )
        share = fem.Function(grid.space)
        volume = dolfinx_versions.compile_form(sum(w) * at_corners)
        dolfinx_versions.assemble_vector(share, volume)
        dolfinx_versions.gather(share)
        self._share = motion.nodal(share)[part.shared]
        work = inner(self._force, motion.w) * at_corners

        def energy() -> dict[str, object]:
            self._asked = True
            return {"work": -inner(self._mean, motion.u) * at_corners}

        return Contribution(work, force=work, energy=energy, before=[self._prepare])

    def _damping(self, w):
        """Virtual work of Rayleigh damping at the incoming velocity."""
        part = self.part
        self._v = fem.Function(self.grid.space)
        α, β = map(part.field, self.incoming.damping(self.grid.centres).T)
        rate = weak_forms.hooke(β * part.λ, β * part.μ, weak_forms.strain(self._v))
        return weak_forms.internal_work(rate, w) + weak_forms.inertia(α * part.density, self._v, w)

    def _prepare(self, start: float, end: float) -> None:
        shared, motion = self.part.shared, self.scene.motion
        at = self._x[shared]
        moved = self._load(end, at) - self._load(start, at)
        motion.nodal(self.brought)[shared] = moved
        weight, after = motion.stepping.start, self._forces(end)
        motion.nodal(self._force)[shared] = after
        if weight or self._asked:
            before = self._forces(start)
            motion.nodal(self._force)[shared] += weight * before
            motion.nodal(self._mean)[shared] = 0.5 * (before + after)

    def _forces(self, t: float) -> np.ndarray:
        """Forces (shared nodes, dim) of the ground's cells, over the volume that each node has at
        corners (N/m³)."""
        motion, at = self.scene.motion, self._x[self._nodes]
        motion.nodal(self._u)[self._nodes] = self.incoming.displacement(t, at)
        motion.nodal(self._a)[self._nodes] = self.incoming.acceleration(t, at)
        if self._damps:
            motion.nodal(self._v)[self._nodes] = self.incoming.velocity(t, at)
        self._sum.x.array[:] = 0.0
        dolfinx_versions.assemble_vector(self._sum, self._form)
        dolfinx_versions.gather(self._sum)
        return motion.nodal(self._sum)[self.part.shared] / self._share


def places(scene: Scene, on: Surface) -> np.ndarray:
    """Places (n, dim), m, of the nodes of facets with material beside them, or of surface
    points."""
    if not isinstance(on, GridSurface):
        return on.x
    held = _held(scene)
    found = [x for nodes, x in each_facet(scene.grid, on) if held[nodes].all()]
    return np.concatenate([np.zeros((0, scene.grid.dim)), *found])
