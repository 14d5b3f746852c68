"""A slope of sensitive clay on firm ground in an earthquake.

Level ground of two heights, and a slope between them, of clay on firmer clay; rock lies below, and
sends an earthquake up.  The ground goes on level on both sides: each has a free field of its own
height.  Strength is undrained, Tresca's, and falls with plastic strain; kinematics are finite.
First the weight is applied, in a quasi-static run between rollers; then dashpots bear what these
bore, and the earthquake comes in.  No answer is known for the slope that fails.  Exact are: nothing
moves before the record does, level ground moves as its column does, and energy balances.  Units: m,
s, kg, Pa.

    slope = ShakenSlope()
    run = slope.at_rest()
    run.until(slope.end)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

import mpm_fenicsx as mpm

G, START = 9.81, 0.5
"""m/s², and when the shaking begins (s)."""


def height_of(on: mpm.SurfacePoints) -> float:
    """Where a vertical edge ends above (m), after the ground has settled."""
    middle = on.x[:, 1].reshape(-1, on.per_face).mean(axis=1)
    return float((middle + 0.5 * on.area.reshape(-1, on.per_face).sum(axis=1)).max())


def cycles(peak: float, frequency: float, count: int, start: float = START) -> mpm.Record:
    """A shaking of so many cycles that grow and fade, after ``start`` (s) of rest.

    ``peak`` (m/s²) of a cosine of ``frequency`` (Hz) in a bell sin²: for a whole number of cycles
    above one it ends at rest, where it began.
    """
    dt, length = 0.005, count / frequency
    t = dt * np.arange(round((start + length) / dt) + 1) - start
    bell = np.where(t > 0.0, np.sin(np.pi * t / length) ** 2, 0.0)
    return mpm.Record(peak * bell * np.cos(2 * np.pi * frequency * t), dt, "cycles")


def sliding_block(acceleration: np.ndarray, dt: float, least: float) -> np.ndarray:
    """How far (n,), m, a block on ground that moves by ``acceleration`` (n,), m/s², each ``dt``
    (s), has slid along +x, which it does while the ground accelerates along −x by more than
    ``least`` (m/s²), and until it has the ground's velocity (Newmark, Géotechnique 15, 1965)."""
    v, slid = 0.0, np.zeros(len(acceleration))
    for i, a in enumerate(acceleration[:-1]):
        after = max(0.0, v + dt * (-a - least))
        slid[i + 1] = slid[i] + 0.5 * dt * (v + after)
        v = after
    return slid


@dataclass(frozen=True)
class ShakenSlope:
    """The slope, its soil and its earthquake.

    ``cell`` (m); heights (m) above the rock: ``crest`` and ``foreland`` of the ground behind and
    before the slope, which falls by 1 on ``run_per_rise``; ``behind`` and ``before`` (m): how far
    the box goes beyond it.  ``strength`` (Pa) at first, which falls to ``residual`` over a plastic
    strain ``fades`` (-), of the clay above the foreland, and ``firm`` that of the clay below.
    ``steps`` in which the weight is applied; ``room``: cells beyond the box for what moves.
    ``motion``: the up-going wave at the rock.  ``yields``: False for elastic ground at small
    strain, which has no weight.
    """

    cell: float = 1.0
    crest: float = 10.0
    foreland: float = 4.0
    run_per_rise: float = 1.0
    behind: float = 20.0
    before: float = 20.0
    strength: float = 21e3
    residual: float = 8e3
    fades: float = 0.1
    firm: float = 80e3
    young: float = 25e6
    poisson: float = 0.4
    density: float = 1900.0
    steps: int = 10
    room: int = 3
    yields: bool = True
    motion: object = field(default_factory=lambda: cycles(0.55, 1.0, 6))
    mapping: mpm.Mapping = mpm.DM_GC

    @property
    def width(self) -> float:
        """Of the box (m)."""
        return self.behind + self.run_per_rise * (self.crest - self.foreland) + self.before

    @cached_property
    def rock(self) -> mpm.LinearElastic:
        """Outside, below the base."""
        return mpm.LinearElastic(400e6, 0.3, 2200.0)

    def elastic(self, kind=mpm.LinearElastic) -> mpm.LinearElastic:
        """Both clays while they do not yield."""
        return kind(self.young, self.poisson, self.density)

    def soils(self, kind=mpm.LinearElastic) -> list:
        """The clay above and the one below, at small strain or on ``Hencky``."""
        if not self.yields:
            return [self.elastic()] * 2
        fading = mpm.Curve((0.0, self.fades), (self.strength, self.residual))
        return [mpm.Tresca(self.elastic(kind), c) for c in (fading, self.firm)]

    def height(self, x: np.ndarray) -> np.ndarray:
        """Of the ground (n,), m, at distances x (n,)."""
        fall = self.crest - (x - self.behind) / self.run_per_rise
        return np.clip(fall, self.foreland, self.crest)

    def above(self, x: np.ndarray) -> np.ndarray:
        """Whether places x (2, n) lie above the firm clay."""
        return x[1] > self.foreland

    def grid(self, room: int) -> mpm.Grid:
        """With so many cells of room at the sides and below, and three above the crest."""
        h = self.cell
        low = np.array([-room, -room])
        high = np.array([round(self.width / h) + room, round(self.crest / h) + 3])
        return mpm.Grid.box(low * h, high * h, high - low)

    def bodies(self, grid: mpm.Grid) -> list[mpm.MaterialPoints]:
        """Points of the two clays, cut along the slope."""
        upper, lower = self.soils(mpm.Hencky if self.yields else mpm.LinearElastic)
        within = lambda x: (x[0] > 0.0) & (x[0] < self.width) & (x[1] > 0.0)  # noqa: E731
        fill = mpm.MaterialPoints.fill
        return [
            fill(
                grid,
                upper,
                4,
                lambda x: within(x) & self.above(x) & (x[1] < self.height(x[0])),
            ),
            fill(grid, lower, 4, lambda x: within(x) & ~self.above(x)),
        ]

    def edges(self, bodies: list[mpm.MaterialPoints]) -> dict[str, list[mpm.SurfacePoints]]:
        """Surface points at the left, the right and the base, those of each clay."""
        near = 1e-3 * self.cell
        at = {
            "left": lambda x: x[0] < near,
            "right": lambda x: x[0] > self.width - near,
            "bottom": lambda x: x[1] < near,
        }
        upper, lower = bodies
        of = {"left": (upper, lower), "right": (lower,), "bottom": (lower,)}
        return {side: [body.surface(side, where=at[side]) for body in of[side]] for side in of}

    def weight(self, bodies: list) -> tuple[list, dict[str, list]]:
        """Apply the weight to bodies between rollers; the tractions that bear it, and the edges."""
        grid = self.grid(0)
        supports = [mpm.Fixed(grid.facets("left", "right"), "x"), mpm.Fixed(grid.facets("bottom"))]
        static = mpm.Simulation(
            grid,
            bodies,
            mpm.QuasiStatic(self.steps),
            [*supports, mpm.Gravity(lambda t: (0.0, -G * t))],
            self.mapping,
        )
        static.until(1.0)
        static.settle(1e-10)
        edges = self.edges(bodies)
        return static.reactions(*(s for side in edges.values() for s in side)), edges

    def base(self, on) -> list:
        """Rock below, and the earthquake that comes up through it."""
        return [mpm.ViscousBoundary(on, self.rock), mpm.IncidentWave(on, self.rock, self.motion)]

    @property
    def toe(self) -> float:
        """Where the slope meets the foreland (m)."""
        return self.behind + self.run_per_rise * (self.crest - self.foreland)

    def yield_acceleration(self, strength: float) -> float:
        """Horizontal acceleration (m/s²) of the ground, constant, at which the clay above the
        foreland begins to slide on a circle through the toe; negative where it slides by itself.

        The least k of all circles with c R² Δθ = Σ w (arm + k/g height): moments of the strength c
        along the arc, and of weight and inertia of 400 slices, about the centre.  Circles that go
        into the firm clay are left out.
        """
        least, rise = np.inf, self.crest - self.foreland
        for left in np.linspace(self.behind - 2.5 * rise, self.behind - 0.05 * rise, 40):
            chord = np.array([self.toe - left, -rise])
            long = np.hypot(*chord)
            upwards = np.array([rise, self.toe - left]) / long
            for share in np.geomspace(0.51, 20.0, 40):  # R of the chord's length
                R = share * long
                centre = np.array([left, self.crest]) + 0.5 * chord
                centre = centre + np.sqrt(R**2 - 0.25 * long**2) * upwards
                if centre[0] < self.toe:  # lower than the toe below the centre
                    continue
                x = left + (np.arange(400) + 0.5) * (self.toe - left) / 400
                arc = centre[1] - np.sqrt(np.maximum(R**2 - (x - centre[0]) ** 2, 0.0))
                thick = np.maximum(self.height(x) - arc, 0.0)
                w = self.density * G * thick * (self.toe - left) / 400
                angle = 2 * np.arcsin(0.5 * long / R)
                driving = (w * (centre[0] - x)).sum()
                inertia = (w * (centre[1] - arc - 0.5 * thick)).sum() / G
                least = min(least, (strength * R**2 * angle - driving) / inertia)
        return float(least)

    def run_out(self, clay: mpm.MaterialPoints) -> float:
        """How far from the toe (m) 0.5 m² of the upper clay have got, or farther."""
        order = np.argsort(-clay.x[:, 0])
        beyond = np.cumsum(clay.volume[order])
        return float(clay.x[order, 0][np.searchsorted(beyond, 0.5)] - self.toe)

    def free_fields(self, edges: dict[str, list]) -> list:
        """Dashpots at the sides, and the columns that tell what comes in there."""
        upper, lower = self.soils()
        both = [(upper, self.above), (lower, lambda x: ~self.above(x))]
        terms = []
        for side, layers in (("left", both), ("right", lower)):
            top = max(height_of(on) for on in edges[side])
            weight = self.density * G * top

            def column(grid, weight=weight):
                terms = self.base(grid.facets("bottom"))
                if self.yields:
                    terms.append(mpm.Gravity((0.0, -G)))
                    terms.append(mpm.Traction(grid.facets("bottom"), (0.0, weight)))
                return terms

            at_rest = mpm.GeostaticStress(layers, top, self.poisson / (1 - self.poisson))
            terms += [mpm.ViscousBoundary(on, self.elastic()) for on in edges[side]]
            terms.append(
                mpm.FreeField(edges[side], layers, column, at_rest if self.yields else None)
            )
        return terms

    def start(self, dt: float | None = None, **options) -> mpm.Simulation:
        """The dynamic run, from rest, in steps of dt (s), by default 1.5 cells of an S wave."""
        bodies = self.bodies(self.grid(0))
        carried, edges = self.weight(bodies) if self.yields else ([], self.edges(bodies))
        grid = self.grid(self.room)
        terms = [*carried, *self.base(edges["bottom"][0]), *self.free_fields(edges)]
        if self.yields:
            terms.append(mpm.Gravity((0.0, -G)))
        step = mpm.Newmark(dt or 1.5 * self.cell / self.elastic().s_speed)
        return mpm.Simulation(grid, bodies, step, terms, self.mapping, **options)
