"""Virtual work of the body: inertia, elasticity, gravity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from dolfinx import fem

from ..grid import weak_forms
from .contribution import Contribution
from .load_functions import combined
from .scene import Scene


def inertia(scene: Scene) -> Contribution:
    """Virtual work ∫ ρ a·w.  Of finite elements it goes into the form of their stress, which is
    assembled anyway; of material points it would be a form by itself."""
    motion = scene.motion
    work = weak_forms.inertia(scene.density, motion.acceleration, motion.w) * scene.dx
    return Contribution(work, mass=scene.mass if scene.partly_filled else None)


def elastic_work(scene: Scene, u, w, lame: tuple | None = None):
    """Virtual work of the elastic stress of u against w, with the scene's λ and μ or those in
    ``lame``.

    With ``scene.b_bar`` volume changes cell by cell: its work is taken with one point a cell, where
    the divergence is the cell's mean on rectilinear grids (B-bar; Hughes 1980), and near it on
    others (selective reduced integration).
    """
    centre = scene.motion.region.dx(metadata={"quadrature_degree": 1}) if scene.b_bar else None
    given = scene.lame if lame is None else lame
    return weak_forms.elastic_work(*given, u, w, scene.stiffness_dx, centre)


def elasticity(scene: Scene, before=None) -> Contribution:
    """Virtual work of the stress of the increment u, on top of the displacement ``before`` if that
    is given."""
    motion = scene.motion
    u = motion.u if before is None else motion.known(before) + motion.u
    work = elastic_work(scene, u, motion.w)
    return Contribution(work, force=work)


def distortion(scene: Scene) -> Contribution:
    """Virtual work of the deviator of that stress alone."""
    motion = scene.motion
    work = weak_forms.distortion_work(scene.lame[1], motion.u, motion.w) * scene.stiffness_dx
    return Contribution(work, force=work)


@dataclass(frozen=True)
class Gravity:
    """Body force per mass (m/s²): ``g`` is (dim,) numbers or a function of t, or of t and x (n,
    dim).

    What depends on place is taken at the material points, where they are at the start of the step;
    in finite elements at the nodes, linear between them.
    """

    g: Callable | tuple[float, ...]

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work -∫ ρ g·w, and the work done."""
        motion, scene.body_loaded = scene.motion, True
        function, placed = scene.load("g of Gravity", self.g)
        bodies = [(scene.density, scene.dx), *((p.density, p.dx) for p in scene.plain if p.heavy)]
        forces = [
            (partial(_at_nodes, scene, density) if placed else partial(_everywhere, scene, density))
            for density, _ in bodies
        ]
        if placed and scene.body_force is not None:
            forces[0] = scene.body_force

        contribution = Contribution()

        def weight(value: Callable[[float, float, np.ndarray], np.ndarray], on):
            work = 0
            for force, (_, dx) in zip(forces, bodies, strict=True):
                found, refresh = force(value)
                contribution.before.append(refresh)
                work += weak_forms.load(found, on) * dx
            return work

        def energy() -> dict[str, object]:
            mean = partial(combined, function)
            return {"work": weight(lambda a, b, x: 0.5 * mean(a, b, x, 1.0), motion.u)}

        contribution.work = contribution.force = -weight(
            lambda start, end, x: combined(function, start, end, x, motion.stepping.start),
            motion.w,
        )
        contribution.energy = energy
        return contribution


def _everywhere(
    scene: Scene, density, value: Callable
) -> tuple[object, Callable[[float, float], None]]:
    """ρb of a body force that is the same everywhere, and what refreshes it."""
    g, x = fem.Constant(scene.grid.mesh, np.zeros(scene.grid.dim)), np.zeros((1, scene.grid.dim))

    def refresh(start: float, end: float) -> None:
        g.value[:] = value(start, end, x)

    return density * g, refresh


def _at_nodes(
    scene: Scene, density, value: Callable
) -> tuple[object, Callable[[float, float], None]]:
    """The same of one that is given at the nodes."""
    g = fem.Function(scene.grid.space)
    x = scene.grid.space.tabulate_dof_coordinates()[:, : scene.grid.dim]

    def refresh(start: float, end: float) -> None:
        scene.motion.nodal(g)[:] = value(start, end, x)

    return density * g, refresh
