"""Plane waves that come in through an absorbing boundary: earthquakes."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from ..analytical.plane_waves import KINDS, PlaneWaves
from ..common.checks import an_object, array, finite, in_short, one_of
from ..common.ranks import bounds, warn
from ..dynamics.record import Record
from ..dynamics.waveform import Waveform
from ..grid.grid import GridSurface
from ..materials.law_checks import has
from ..points.surface_points import SurfacePoints
from .absorbing import ViscousBoundary, in_words
from .absorbing_layer import AbsorbingLayer
from .contribution import Contribution
from .incoming import IntoLayer, boundaries_on, into_boundaries, places
from .loads import Surface
from .regions import regions_of
from .scene import Scene

LARGEST = 100.0
"""Acceleration (m/s²) above which a motion is hardly one of the ground: ten times that of
gravity."""
SAMPLES = 4000
"""Steps over which a waveform is looked at when a run is built."""
ALIKE = 0.05
"""Of the largest velocity: by how much displacement and velocity of a waveform may disagree, or be
there before the start."""
SAME = 1e-6
"""Of impedances: by how much those of wave and boundary may differ."""


@dataclass(frozen=True, eq=False)
class IncidentWave:
    """A plane wave comes in through dashpots, springs or a layer, which absorb all that goes out.

    ``on``: the surface on which a ``ViscousBoundary`` or ``ViscoelasticBoundary`` acts, or a part
    of its facets; or the ``AbsorbingLayer`` of the scene, all its sides at once.  ``material``: the
    elastic half-space outside, of the density and speeds that the boundary has.
    ``motion``: a ``Record``, or a ``Waveform``, displacement, velocity and acceleration as
    functions of time.  ``kind``: what it is the motion of, "up-going", the incoming wave itself at
    ``origin``, or "outcrop", a free surface of that half-space without the ground above, which
    moves twice as much (vertical incidence alone).  What the base itself does, the motion within,
    is no wave: that is ``Fixed(base, "x", acceleration=record)``.

    ``wave``: "SV", "P" or, in 3D, "SH"; ``angle`` (degrees) from the vertical, positive towards
    ``azimuth`` (degrees, 3D: from x towards z), in 2D towards +x.  At vertical incidence SV moves
    along the azimuth, P upwards.
    ``surface``: the height (m) of the free surface of homogeneous ground: what it sends back comes
    in with the wave, and the boundaries bear what differs from both.  Sides need it; a base may do
    without, and then takes in what comes up alone, whatever ground lies above.
    ``origin`` (dim,), m: where the incoming wave has its motion; by default where it meets first
    what the scene's incident waves without an origin come in through.

    Raises ``ValueError`` naming what is wrong: a name, an angle beyond the critical one where there
    is a surface, one between tied sides, nothing that absorbs on ``on`` or of another impedance,
    ground in a layer other than ``material``, ``on`` where nodes are held in the wave's direction.
    """

    on: Surface | AbsorbingLayer
    material: object
    motion: object
    kind: str = "up-going"
    wave: str = "SV"
    angle: float = 0.0
    azimuth: float = 0.0
    surface: float | None = None
    origin: tuple[float, ...] | None = None

    beside_others = 2  # after layers

    def __post_init__(self) -> None:
        an_object(
            "on",
            self.on,
            (GridSurface, SurfacePoints, AbsorbingLayer),
            'a surface, such as grid.facets("bottom"), or an AbsorbingLayer',
        )
        has("material of IncidentWave", self.material, ("density", "p_speed", "s_speed"))
        one_of("wave", self.wave, KINDS)
        angle = finite("angle", self.angle)
        if self.surface is not None:
            finite("surface", self.surface)
        if self.kind == "within":
            raise ValueError(
                'kind must be "up-going" or "outcrop", got "within": the motion of the base itself '
                'is no wave, give it by Fixed(base, "x", acceleration=record)'
            )
        if self.kind not in ("up-going", "outcrop"):
            raise ValueError(
                f'kind must be "up-going", the incoming wave itself, or "outcrop", twice that at a '
                f"free surface, got {self.kind!r}"
            )
        if self.kind == "outcrop" and angle:
            raise ValueError(
                f"kind: a wave at angle = {angle} moves an outcrop both ways: give the up-going "
                "wave (analytical.plane_waves.surface_motion tells how the two compare)"
            )
        waveform_of(self.motion)

    def take_cells(self, scene: Scene) -> None:
        """The cells of a layer bear what differs from the wave."""
        if isinstance(self.on, AbsorbingLayer) and scene.motion.stepping.dynamic:
            scene.bring_into(self, self.on)

    def bind(self, scene: Scene) -> Contribution:
        """What the boundary has to bear of the wave."""
        if not scene.motion.stepping.dynamic:
            raise ValueError(
                "IncidentWave needs velocities: step with Newmark, after a quasi-static run "
                "without it"
            )
        if isinstance(self.on, AbsorbingLayer):
            part = scene.part(self.on)
            self._refuse_other_ground(self.on)
            waves = self._waves(scene, _through(scene, self.on))
            contribution = IntoLayer(scene, "IncidentWave", part, waves).bind()
        else:
            boundaries = self._boundaries(scene)
            waves = self._waves(scene, _through(scene, self.on))
            contribution = into_boundaries(scene, "IncidentWave", boundaries, waves)
        contribution.note = (
            f"{self.kind} {self.wave} at {self.angle:g}° from "
            f"{', '.join(f'{round(c, 9) + 0.0:g}' for c in waves.origin)}"
        )
        return contribution

    def _boundaries(self, scene: Scene) -> list[tuple[Surface, list[ViscousBoundary]]]:
        """The terms that absorb on the surface."""
        found = boundaries_on(scene, "IncidentWave", self.on)
        of_wave = self.material.density * np.array([self.material.p_speed, self.material.s_speed])
        for term in (term for _, acting in found for term in acting):
            if not np.allclose(term.impedance, of_wave, rtol=SAME, atol=0.0):
                raise ValueError(
                    f"material: IncidentWave comes through ground of impedances {in_words(of_wave)}"
                    f", and {type(term).__name__} there has {in_words(term.impedance)}: both are "
                    "those of the half-space outside"
                )
        return found

    def _refuse_other_ground(self, layer: AbsorbingLayer) -> None:
        numbers = ("density", "p_speed", "s_speed")
        own = np.array([getattr(self.material, name) for name in numbers])
        for law, _ in regions_of(layer.material):
            of_layer = np.array([getattr(law, name) for name in numbers])
            if not np.allclose(of_layer, own, rtol=SAME, atol=0.0):
                raise ValueError(
                    "material: IncidentWave comes through homogeneous ground, and its "
                    f"AbsorbingLayer is of {law!r} where the wave's is {self.material!r}: for "
                    "layers of ground take FreeField, or a layer below them alone"
                )

    def check(self, scene: Scene) -> None:
        """Raise ``ValueError`` where supports hold what the wave moves, or sides are tied that it
        goes past at an angle."""
        if not scene.motion.stepping.dynamic:
            return
        across = set() if scene.sides is None else set(scene.sides.directions)
        if self.angle and across - {1}:
            raise ValueError(
                f"angle: a wave at {self.angle:g}° is not the same at both of two tied sides, got "
                "Tied: take IncidentWave on base and sides, with surface=, or angle=0"
            )
        tags = set(getattr(self.on, "tags", ()))
        for support in scene.supports:
            held = self._moves(scene.grid.dim) & set(support.components or "xyz")
            if held and tags & set(support.on.tags):
                raise ValueError(
                    f"on: Fixed holds {' and '.join(sorted(held))} where IncidentWave comes in, "
                    "which then moves nothing: give the wave to what absorbs, or the motion of "
                    "the base itself, the motion within, to Fixed"
                )

    def _moves(self, dim: int) -> set[str]:
        """The directions that the wave moves."""
        if self.angle:
            return set("xyz"[:dim])
        if self.wave == "P":
            return {"y"}
        turn = np.radians(self.azimuth + 90.0 * (self.wave == "SH"))
        along = {"x": np.cos(turn), "z": np.sin(turn)}
        return {c for c, share in along.items() if abs(share) > 1e-9}

    def _waves(self, scene: Scene, x: np.ndarray) -> PlaneWaves:
        """The waves, of places (n, dim), m, where they come in."""
        dim = scene.grid.dim
        if not scene.grid.comm.allreduce(len(x)):
            raise ValueError(
                f"on: no material is beside {self.on}, where IncidentWave comes in: take the "
                'surface of the body, points.surface("bottom")'
            )
        low, high = bounds(scene.grid.comm, x)
        sides = self._has_sides(scene, low, high)
        if self.surface is None and sides:
            raise ValueError(
                "surface: IncidentWave comes in through sides, and has to know what the free "
                "surface sends back past them: give its height (m)"
            )
        if sides:
            self._compare_surface(scene, high[1])
        waveform = waveform_of(self.motion)
        if self.kind == "outcrop":
            waveform = scaled(waveform, 0.5)

        def waves(origin: np.ndarray) -> PlaneWaves:
            return PlaneWaves(
                kind=self.wave,
                angle=self.angle,
                density=self.material.density,
                p_speed=self.material.p_speed,
                s_speed=self.material.s_speed,
                motion=waveform,
                origin=tuple(origin.tolist()),
                surface=self.surface,
                dim=dim,
                azimuth=self.azimuth,
            )

        if self.origin is not None:
            found = waves(array("origin", self.origin))
        else:
            all_in = [
                _through(scene, term.on)
                for term in scene.terms
                if isinstance(term, IncidentWave) and term.origin is None
            ]
            low, high = bounds(scene.grid.comm, np.concatenate(all_in))
            found = waves(_first(waves(low), low, high))
        self._look(scene, waveform, found, x)
        return found

    def _compare_surface(self, scene: Scene, top: float) -> None:
        """Warn of a free surface elsewhere than where the sides end."""
        if abs(self.surface - top) > scene.grid.smallest:
            warn(
                scene.grid.comm,
                f"surface: IncidentWave takes the free surface to be at y = {self.surface:g} m, "
                f"and the sides that it comes in through end at {top:g} m",
                4,
            )

    def _has_sides(self, scene: Scene, low: np.ndarray, high: np.ndarray) -> bool:
        if isinstance(self.on, GridSurface | AbsorbingLayer):
            return bool(high[1] - low[1] > 1e-6 * (high - low).max())
        steep = np.abs(self.on.normal[:, 1]) < 0.5 if len(self.on) else np.zeros(0, bool)
        return bool(scene.grid.comm.allreduce(int(steep.any())))

    def _look(self, scene: Scene, waveform: Waveform, waves: PlaneWaves, x: np.ndarray) -> None:
        """Warn of a waveform that can hardly be meant; refuse one that disagrees with itself."""
        comm, dt = scene.grid.comm, scene.motion.stepping.dt
        if isinstance(self.motion, Record):
            doubt = self.motion.doubt_of_steps(dt)
            if doubt is not None:
                warn(comm, f"motion: {doubt}", 4)
        else:
            _check(comm, waveform, dt)
        largest = np.abs(waveform.velocity(dt * np.arange(SAMPLES))).max()
        moves = np.abs(waves.velocity(0.0, x)).max(initial=0.0)
        if comm.allreduce(moves, op=MPI.MAX) > ALIKE * largest:
            warn(
                comm,
                "motion: IncidentWave moves the boundary at t = 0 already, while the ground is at "
                "rest: let it begin later, or name as origin a place that it meets first",
                4,
            )


def _check(comm: MPI.Comm, waveform: Waveform, dt: float) -> None:
    """Warn of accelerations that can hardly be meant; raise ``ValueError`` where one of the three
    functions is not the rate of the one before it."""
    t = dt * np.arange(SAMPLES)
    u, v, a = (
        np.broadcast_to(f(t), t.shape)
        for f in (waveform.displacement, waveform.velocity, waveform.acceleration)
    )
    if np.abs(a).max() > LARGEST:
        warn(
            comm,
            f"motion: IncidentWave accelerates by {np.abs(a).max():.3g} m/s², more than any "
            "earthquake: is it in cm/s², or in other units than m and s?",
            5,
        )
    for name, rate, of in (("velocity", v, u), ("acceleration", a, v)):
        by_rule = 0.5 * dt * (rate[1:] + rate[:-1])
        change = np.diff(of)
        size = max(np.abs(change).max(), np.abs(by_rule).max())
        if np.abs(change - by_rule).max() > 0.5 * size:
            raise ValueError(
                f"motion: {name} of the waveform is not the rate of what it should be, over "
                f"steps of {dt:g} s: are all three in m and s, and the step short enough?"
            )


def waveform_of(motion) -> Waveform:
    """A motion as functions of time.  Raises ``ValueError`` for what is none."""
    if hasattr(motion, "waveform"):
        return motion.waveform()
    names = ("displacement", "velocity", "acceleration")
    if not all(callable(getattr(motion, name, None)) for name in names):
        raise ValueError(
            "motion must be a Record, or Waveform(displacement, velocity, acceleration), functions "
            f"of time in m, m/s and m/s², got {in_short(motion)}"
        )
    return Waveform(*(_of_arrays(getattr(motion, name)) for name in names))


def scaled(waveform: Waveform, factor: float) -> Waveform:
    """So many times a motion."""
    return Waveform(
        lambda t: factor * waveform.displacement(t),
        lambda t: factor * waveform.velocity(t),
        lambda t: factor * waveform.acceleration(t),
    )


def _of_arrays(function):
    """A function of time that takes times (n,)."""
    with np.errstate(all="ignore"):
        try:
            found = np.asarray(function(np.array([0.0, 0.5, 1.0])), float)
        except Exception:
            found = None
    if found is not None and found.shape in ((), (3,)):
        return function
    return np.vectorize(function, otypes=[float])


def _through(scene: Scene, on: Surface | AbsorbingLayer) -> np.ndarray:
    """Places (n, dim), m, of what a wave comes in through."""
    if not isinstance(on, AbsorbingLayer):
        return places(scene, on)
    shared = scene.part(on).shared
    return scene.grid.space.tabulate_dof_coordinates()[shared, : scene.grid.dim]


def _first(waves: PlaneWaves, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The corner of a box that the incoming wave meets first."""
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1)
    corners = corners.reshape(-1, len(low))
    return corners[np.argmin(waves.delays(corners, incoming_only=True)[0])]
