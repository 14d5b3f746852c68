"""A concrete dam on a half-space of rock, and an earthquake that comes up obliquely.

The dam is of material points, cut along its faces; the rock below is an elastic far field.  At its
sides and its base an absorbing layer, or dashpots, take the wave in and what the dam scatters out.
Exact is the rock without the dam (``DamOnRock.exact``), which the surface far from the dam
approaches.  Nothing has weight: all is elastic, and motion adds to the state at rest.  Units: m, s,
kg, Pa.

    dam = DamOnRock("layer")
    run = dam.simulation()
    watch = run.record(Watch(dam))
    run.until(dam.end)
    watch.crest
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import mpm_fenicsx as mpm

from ..analytical.plane_waves import PlaneWaves, surface_motion

ROCK = mpm.LinearElastic(young=5e9, poisson=0.25, density=2500.0)
CONCRETE = mpm.LinearElastic(young=25e9, poisson=0.2, density=2400.0)
BOUNDARIES = ("layer", "viscous")
SIDES = ("left", "right", "bottom")


class Watch:
    """Recorder of velocities (steps, places, 2), m/s, of nodes of the rock's surface beside the
    dam, ``x`` (places,), m, and of its crest and its heel, (steps, 2) each."""

    def __init__(self, scene: DamOnRock):
        self.scene, self.times, self._rows = scene, [], []

    def attach(self, run) -> None:
        """Find the places."""
        scene = self.scene
        place, self._read = run.sampler("velocity")
        beside = np.abs(place[:, 0]) > 0.5 * scene.base + 1e-6
        beside &= np.abs(place[:, 0]) < scene.half + 1e-6
        found = np.flatnonzero(beside & (np.abs(place[:, 1]) < 1e-6))
        self._places = found[np.argsort(place[found, 0])]
        self.x = place[self._places, 0]
        self._probes = []
        if run.holds(np.array(scene.crest)):
            self._probes = [mpm.Probe("velocity", at) for at in (scene.crest, scene.heel)]
        for probe in self._probes:
            probe.attach(run)
        self._note(run)

    def __call__(self, run) -> None:
        """Note the step."""
        for probe in self._probes:
            probe(run)
        self._note(run)

    def _note(self, run) -> None:
        self.times.append(run.time)
        self._rows.append(self._read(self._places).copy())

    @property
    def surface(self) -> np.ndarray:
        """Of the rock's surface (steps, places, 2), m/s."""
        return np.array(self._rows)

    @property
    def crest(self) -> np.ndarray:
        """Of the dam's crest (steps, 2), m/s."""
        return np.array(self._probes[0].values)

    @property
    def heel(self) -> np.ndarray:
        """Of the rock below the dam's upright face (steps, 2), m/s."""
        return np.array(self._probes[1].values)


@dataclass(frozen=True)
class DamOnRock:
    """The dam, its box of rock and the wave.

    ``boundary``: one of ``BOUNDARIES``; ``half`` (m): half the box's width, and its depth, a
    multiple of ``cell`` (m).  ``height``, ``base`` and ``top`` (m) of the dam, whose left face is
    upright, and ``foot`` (m) the height of the right one's upright part, a multiple of ``cell``.
    ``angle`` (degrees) of the SV wave from the vertical, ``frequency`` (Hz) and ``peak`` (m/s) of
    its wavelet.
    """

    boundary: str = "layer"
    half: float = 40.0
    cell: float = 2.5
    height: float = 30.0
    base: float = 30.0
    top: float = 5.0
    foot: float = 5.0
    angle: float = 15.0
    frequency: float = 8.0
    peak: float = 0.1

    def __post_init__(self) -> None:
        if self.boundary not in BOUNDARIES:
            raise ValueError(f"boundary must be one of {BOUNDARIES}, got {self.boundary!r}")

    @property
    def crest(self) -> tuple[float, float]:
        """In the middle of the dam's crest (m)."""
        return -0.5 * self.base + 0.5 * self.top, self.height

    @property
    def heel(self) -> tuple[float, float]:
        """In the rock below the upright face (m)."""
        return -0.5 * self.base, -1e-6

    @property
    def step(self) -> float:
        """In which P waves of the concrete cross two cells (s); a whole number until the end."""
        rough = 2 * self.cell / CONCRETE.p_speed
        return self.end / np.ceil(self.end / rough)

    @property
    def motion(self) -> mpm.Waveform:
        """Of the incoming wave, at the middle of the dam's base."""
        middle = 1.5 / self.frequency + self._earlier
        return mpm.Waveform.ricker(self.frequency, self.peak, middle)

    @property
    def amplification(self) -> np.ndarray:
        """Motion (2,) of the rock's surface without the dam over that of the wave."""
        return surface_motion("SV", self.angle, ROCK.p_speed, ROCK.s_speed)

    @property
    def _earlier(self) -> float:
        """How much earlier than the dam the wave may meet a box of 120 m (s)."""
        return 120.0 * (1.0 + np.sin(np.radians(abs(self.angle)))) / ROCK.s_speed

    def in_dam(self, x: np.ndarray) -> np.ndarray:
        """Whether places x (2, n), m, lie in the dam (n,), bool."""
        left, tall = -0.5 * self.base, max(self.height, self.foot + self.cell)
        share = np.clip((x[1] - self.foot) / (tall - self.foot), 0.0, 1.0)
        right = left + self.base - (self.base - self.top) * share
        return (x[1] > 0.0) & (x[1] < self.height) & (x[0] > left) & (x[0] < right)

    def in_rock(self, x: np.ndarray) -> np.ndarray:
        """Whether places x (2, n), m, lie in the box of rock (n,), bool."""
        return (x[1] < 0.0) & (x[1] > -self.half) & (np.abs(x[0]) < self.half)

    def grid(self, up: float) -> mpm.Grid:
        """The rock below y = 0, a layer's cells around it, and air up to a height (m)."""
        h = self.cell
        beyond = mpm.AbsorbingLayer(SIDES, ROCK).thickness if self.boundary == "layer" else 0
        n, above = round(self.half / h) + beyond, round(up / h)

        def of_rock(side: float):
            return lambda x: (np.abs(x[0] - side) < 1e-6 * h) & (x[1] < 1e-6 * h)

        return mpm.Grid.box(
            (-n * h, -n * h),
            (n * h, above * h),
            (2 * n, n + above),
            facets={"left rock": of_rock(-n * h), "right rock": of_rock(n * h)},
        )

    def terms(self, grid: mpm.Grid) -> list:
        """What absorbs around the rock, and the wave that comes in there."""
        if self.boundary == "layer":
            on = absorbing = mpm.AbsorbingLayer(SIDES, ROCK)
        else:
            on = grid.facets("left rock", "right rock", "bottom")
            absorbing = mpm.ViscousBoundary(on, ROCK)
        return [
            absorbing,
            mpm.IncidentWave(
                on, ROCK, self.motion, angle=self.angle, surface=0.0, origin=(0.0, 0.0)
            ),
        ]

    def simulation(self, mapping: mpm.Mapping = mpm.DM_GC) -> mpm.Simulation:
        """Dam and rock, from rest."""
        grid = self.grid(self.height + self.cell)
        dam = mpm.MaterialPoints.fill(grid, CONCRETE, 4, self.in_dam, cut=True)
        terms = [mpm.FarField(self.in_rock, ROCK), *self.terms(grid)]
        return mpm.Simulation(grid, dam, mpm.Newmark(self.step), terms, mapping)

    def rock_alone(self) -> mpm.FiniteElements:
        """The rock without the dam, from rest."""
        grid = self.grid(0.0)
        return mpm.FiniteElements(grid, ROCK, mpm.Newmark(self.step), self.terms(grid))

    def exact(self) -> PlaneWaves:
        """The waves in the rock without the dam."""
        return PlaneWaves(
            "SV",
            self.angle,
            ROCK.density,
            ROCK.p_speed,
            ROCK.s_speed,
            self.motion,
            (0.0, 0.0),
            surface=0.0,
        )

    @property
    def end(self) -> float:
        """When the dam has swung out (s)."""
        return (1.5 + 4.0) / self.frequency + self._earlier
