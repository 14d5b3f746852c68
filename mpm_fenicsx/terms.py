"""Boundaries and loads: each contributes its own virtual work, the simulation sums them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import ufl
from dolfinx import fem
from ufl import inner

from . import forms
from .checks import one_of, positive
from .grid import GridSurface
from .law_checks import has
from .loads import combined, of_time
from .motion import KnownMotion, Motion
from .points import SurfacePoints
from .prescribed import AccelerationRecord, Displacement, Prescribed, WholeMotion
from .scene import Contribution, Scene

Surface = GridSurface | SurfacePoints


def inertia(scene: Scene) -> Contribution:
    """Virtual work ∫ ρ a·w."""
    motion = scene.motion
    return Contribution(forms.inertia(scene.density, motion.acceleration, motion.w) * scene.dx)


def elastic_work(motion: Motion, dx: ufl.Measure, λ, μ, u, w, b_bar: bool = False):
    """Virtual work of the elastic stress of u; ``dx`` integrates what λ and μ weigh.

    With ``b_bar`` volume changes cell by cell: its work is taken with one point a cell, where the divergence is the
    cell's mean on rectilinear grids (B-bar; Hughes 1980), and near it on others (selective reduced integration).
    """
    if not b_bar:
        return forms.internal_work(forms.hooke(λ, μ, forms.strain(u)), w) * dx
    centre = motion.region.dx(metadata={"quadrature_degree": 1})
    return forms.distortion_work(μ, u, w) * dx + forms.dilation_work(λ, μ, u, w) * centre


def elasticity(scene: Scene, dx: ufl.Measure, λ, μ, before=None, b_bar: bool = False) -> Contribution:
    """Virtual work of the stress of the increment u, on top of the displacement ``before`` if that is given."""
    motion = scene.motion
    u = motion.u if before is None else motion.known(before) + motion.u
    work = elastic_work(motion, dx, λ, μ, u, motion.w, b_bar)
    return Contribution(work, force=work)


@dataclass(frozen=True)
class Fixed:
    """No displacement of ``components`` ("x", "xy", …; all by default) on facets of the grid, or a given motion.

    The motion, functions of t (s), is one of

    - ``value``, a displacement (m): velocity and acceleration are derived from it by differences over the step;
    - ``value`` with its ``velocity`` (m/s) and ``acceleration`` (m/s²): all three are taken as they are;
    - ``acceleration`` alone, a record: integrated by the trapezoidal rule, from rest at the start.

    Nodes of known motion have known velocity and acceleration, whatever the points around deposit there.
    The nodes of a material point run's grid move by the increment of the step and are then where they were,
    so that there it serves small settlements.  The work of what is moved is not among the recorder Energy's.
    Raises ``ValueError`` for surface points (they have no nodes of their own), a component that is not there, or
    another set of functions.
    """

    on: GridSurface
    components: str | None = None
    value: Callable[[float], float] | None = None
    velocity: Callable[[float], float] | None = None
    acceleration: Callable[[float], float] | None = None

    def bind(self, scene: Scene) -> Contribution:
        """Add Dirichlet conditions to the scene."""
        if not isinstance(self.on, GridSurface):
            raise ValueError(f"Fixed acts on facets of the grid, got {type(self.on).__name__}")
        prescribed = self._prescribed(scene.motion.stepping.dynamic)
        grid = scene.grid
        if self.on.grid is not grid:
            raise ValueError(f"on: the facets {self.on.names} belong to another grid")
        axes = "xyz"[: grid.dim]
        if self.components is not None and not (isinstance(self.components, str | tuple | list) and self.components):
            raise ValueError(f"components must be one or several of {axes} in a text, got {self.components!r}")
        for c in self.components or axes:
            V = grid.space.sub(axes.index(one_of("components", c, axes)))
            dofs = fem.locate_dofs_topological(V, grid.dim - 1, self.on.facets)
            scene.fixed.append(fem.dirichletbc(np.array(0.0), dofs, V))
            if prescribed is None:
                scene.motion.at_rest.append(dofs)
            else:
                scene.motion.moved.append(KnownMotion(dofs, prescribed))
        if prescribed is not None:
            scene.prescribed.append(prescribed)
        return Contribution()

    def _prescribed(self, dynamic: bool) -> Prescribed | None:
        """The motion given, or None for no motion."""
        names = [name for name in ("value", "velocity", "acceleration") if getattr(self, name) is not None]
        functions = {name: of_time(f"{name} of Fixed", getattr(self, name)) for name in names}
        match names:
            case []:
                return None
            case ["value"]:
                return Displacement(functions["value"])
            case ["value", "velocity", "acceleration"]:
                return WholeMotion(*functions.values())
            case ["acceleration"] if dynamic:
                return AccelerationRecord(functions["acceleration"])
            case ["acceleration"]:
                raise ValueError("acceleration of Fixed is for dynamics: in a quasi-static run give value, "
                                 "a displacement (m) of the load parameter")
        raise ValueError(f"Fixed takes value, or value with velocity and acceleration, or acceleration alone, got "
                         f"{' and '.join(names)}")


@dataclass(frozen=True)
class Traction:
    """Traction (Pa) on a surface: ``value`` is (dim,) numbers, or a function of t, or of t and x (n, dim).

    A load that stays as it is may be given point by point: an array (n, dim) for surface points, which moves with
    them, or a vector field on the mesh for facets.
    """

    on: Surface
    value: Callable | tuple[float, ...] | np.ndarray | fem.Function

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work -∫ t·w, and the work done."""
        patch, motion = scene.patch(self.on), scene.motion
        load = self._load(scene, patch)
        work = -forms.load(load(), motion.w) * patch.measure
        return Contribution(work, lambda: {
            "work": forms.load(load(mean=True), motion.u) * patch.measure}, work)

    def _load(self, scene: Scene, patch) -> Callable:
        held = patch.held(self.value)
        return partial(patch.load, *scene.load("value of Traction", self.value)) if held is None else \
            lambda mean=False: held if mean else scene.motion.known(held)


@dataclass(frozen=True)
class DeadLoad(Traction):
    """A load whose force stays however its surface stretches: ``value`` (Pa) is per area at the start.

    ``value`` is (dim,) numbers, or a function of t, or of t and x (n, dim).  A traction is per area as it is: under one
    that keeps its direction the walls of a crater stretch, bear more, and stretch the faster.  On facets of the grid,
    which do not stretch, the two are one.  The start is when surface points meet their first DeadLoad in a run: later
    runs keep their ``rest_area``.
    """

    def _load(self, scene: Scene, patch) -> Callable:
        function, placed = scene.load("value of DeadLoad", self.value)
        on = self.on
        if isinstance(on, GridSurface):
            return partial(patch.load, function, placed)
        on.remember_area()
        return partial(patch.load, lambda t, x: function(t, x) * (on.rest_area / on.area)[:, None], True)


@dataclass(frozen=True)
class Gravity:
    """Body force per mass (m/s²): ``g`` is (dim,) numbers or a function of t, or of t and x (n, dim).

    What depends on place is taken at the material points, where they are at the start of the step; in finite elements
    at the nodes, linear between them.
    """

    g: Callable | tuple[float, ...]

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work -∫ ρ g·w, and the work done."""
        motion, scene.body_loaded = scene.motion, True
        function, placed = scene.load("g of Gravity", self.g)
        force = (scene.body_force or partial(_at_nodes, scene)) if placed else partial(_everywhere, scene)

        def weight(value: Callable[[float, float, np.ndarray], np.ndarray]):
            found, refresh = force(value)
            scene.before.append(refresh)
            return found

        def energy() -> dict[str, object]:
            mean = weight(lambda start, end, x: 0.5 * combined(function, start, end, x, 1.0))
            return {"work": forms.load(mean, motion.u) * scene.dx}

        g = weight(lambda start, end, x: combined(function, start, end, x, motion.stepping.start))
        work = -forms.load(g, motion.w) * scene.dx
        return Contribution(work, energy, work)


def _everywhere(scene: Scene, value: Callable) -> tuple[object, Callable[[float, float], None]]:
    """ρb of a body force that is the same everywhere, and what refreshes it."""
    g, x = fem.Constant(scene.grid.mesh, np.zeros(scene.grid.dim)), np.zeros((1, scene.grid.dim))

    def refresh(start: float, end: float) -> None:
        g.value[:] = value(start, end, x)

    return scene.density * g, refresh


def _at_nodes(scene: Scene, value: Callable) -> tuple[object, Callable[[float, float], None]]:
    """The same of one that is given at the nodes."""
    g, x = fem.Function(scene.grid.space), scene.grid.space.tabulate_dof_coordinates()[:, : scene.grid.dim]

    def refresh(start: float, end: float) -> None:
        scene.motion.nodal(g)[:] = value(start, end, x)

    return scene.density * g, refresh


@dataclass(frozen=True)
class Viscous:
    """Absorbing dashpots (Lysmer & Kuhlemeyer; Do et al. 2023, eqs. 9, 13, 14).

    σ_n = -ρ c_p v_n, σ_s = -ρ c_s v_s with the elastic constants and density of ``material``.
    """

    on: Surface
    material: object

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work ∫ Z v·w, and the energy absorbed."""
        if not scene.motion.stepping.dynamic:
            raise ValueError(f"{type(self).__name__} needs velocities: step with Newmark")
        patch, motion, soil = scene.patch(self.on), scene.motion, self.material
        has(f"material of {type(self).__name__}", soil, ("density", "p_speed", "s_speed"))
        Z = patch.tensor(soil.density * soil.p_speed, soil.density * soil.s_speed)
        return Contribution(forms.dashpot(Z, motion.velocity, motion.w) * patch.measure, lambda: {
            "absorbed": inner(Z * motion.u, motion.u) / motion.dt * patch.measure})


@dataclass(frozen=True)
class Viscoelastic(Viscous):
    """Dashpots with springs beside them (Deeks & Randolph; Do et al. 2023, eqs. 10, 15, 16).

    k_n = 2 G / r_b, k_s = G / (2 r_b), ``radius`` r_b (m) the distance to the source; the springs act on the
    displacement accumulated since the start.  Raises ``ValueError`` for radius <= 0.
    """

    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive("radius", self.radius))

    def bind(self, scene: Scene) -> Contribution:
        """Virtual work ∫ (Z v + k u)·w, and the energy absorbed and stored."""
        viscous = super().bind(scene)
        has("material of Viscoelastic", self.material, ("lame",))
        patch, motion = scene.patch(self.on), scene.motion
        G = self.material.lame[1]
        stiffness = 2 * G / self.radius, G / (2 * self.radius)
        k, stored = patch.tensor(*stiffness), patch.stored(*stiffness)
        spring = forms.spring(k, motion.u, motion.known(stored), motion.w)
        return Contribution(viscous.work + spring * patch.measure, lambda: {
            **viscous.energy(), "stored": inner(0.5 * k * motion.u + stored, motion.u) * patch.measure})
