"""Site response: a wave comes up through rock into level layers of soil, between tied sides.

Exact is the transfer function of the layers (``analytical.site_response``), with mass and stiffness
damping as the run has them.  Soil that yields has no exact answer; ``equivalent_linear`` is what
engineers compute for it.  Units: m, s, kg, Pa.

    column = SoilColumn(strata, rock, record, step=2e-3)
    run = column.material_points()
    top = run.record(column.probe())
    run.until(record.duration)
    column.error(top)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import mpm_fenicsx as mpm

from ..analytical.equivalent_linear import EquivalentLinear, equivalent_linear
from ..analytical.site_response import HalfSpace, Layer, LayeredGround, split
from ..analytical.waves import relative_error

BASES = "dashpots", "layer"
DIRECTION = {"SV": 0, "P": 1}
"""Component that a wave moves."""


def soil(s_speed: float, density: float, poisson: float = 0.3) -> mpm.LinearElastic:
    """Elastic soil of a speed of shear waves (m/s), a density (kg/m³) and Poisson's ratio."""
    return mpm.LinearElastic(2 * density * s_speed**2 * (1 + poisson), poisson, density)


def synthetic_record(
    duration: float = 16.0,
    peak: float = 1.0,
    low: float = 0.3,
    high: float = 8.0,
    dt: float = 0.005,
    seed: int = 1,
) -> mpm.Record:
    """Noise between two frequencies (Hz) that swells and dies away within ``duration`` (s), and
    leaves the ground at rest.

    ``peak``: largest acceleration (m/s²); ``dt`` (s); ``seed`` of the random numbers.
    """
    time = dt * np.arange(round(duration / dt) + 1)
    grown = 5 * time / duration  # largest at a fifth
    noise = np.random.default_rng(seed).standard_normal(len(time))
    record = mpm.Record(noise * (grown * np.exp(1 - grown)) ** 2, dt, f"noise, seed {seed}")
    return record.filtered(low, high).tapered(0.1 * duration).baseline().scaled(peak=peak)


@dataclass(frozen=True)
class Stratum:
    """A layer of one soil: its ``law``, ``thickness`` (m) and Rayleigh ``damping``, or None."""

    law: object
    thickness: float
    damping: mpm.RayleighDamping | None = None


@dataclass(frozen=True, eq=False)
class SoilColumn:
    """Level ground on rock that a wave comes up through, one cell wide.

    ``strata``: from the surface down, each a whole number of cells of ``cell`` (m) thick; ``rock``:
    the elastic half-space below; ``motion``: ``Record`` or ``Waveform`` of ``kind``, "outcrop" or
    "up-going"; ``step`` (s); ``wave``: "SV" or "P"; ``base``: what absorbs what goes down,
    "dashpots", or a "layer" of cells, for which the last stratum has to be of ``rock``; ``dim`` 2
    or 3, y upwards.
    Raises ``ValueError`` for a base or wave of another name, strata that end within a cell, a
    soil with two dampings, and a layer below other ground than rock.
    """

    strata: tuple[Stratum, ...]
    rock: mpm.LinearElastic
    motion: object
    step: float
    cell: float = 1.0
    kind: str = "outcrop"
    wave: str = "SV"
    base: str = "dashpots"
    dim: int = 2

    def __post_init__(self) -> None:
        object.__setattr__(self, "strata", tuple(self.strata))
        for name, names in (("base", BASES), ("wave", tuple(DIRECTION))):
            value = getattr(self, name)
            if value not in names:
                raise ValueError(f"{name} must be one of {', '.join(names)}, got {value!r}")
        if self.base == "layer" and self.strata[-1].law != self.rock:
            raise ValueError(
                f'base "layer" lies below rock: give {self.rock!r} as the last of the strata, got '
                f"{self.strata[-1].law!r}"
            )
        for stratum in self.strata:
            cells = stratum.thickness / self.cell
            if round(cells) < 1 or abs(cells - round(cells)) > 1e-9 * cells:
                raise ValueError(
                    f"strata must be whole cells of {self.cell:g} m thick, got "
                    f"{stratum.thickness:g} m: choose cell so that it divides them all"
                )
        self._dampings()

    @property
    def depth(self) -> float:
        """Of the rock below the surface (m)."""
        return float(sum(stratum.thickness for stratum in self.strata))

    @property
    def bottoms(self) -> np.ndarray:
        """Heights (strata,), m, of the lower ends of strata; that of the last is 0."""
        return self.depth - np.cumsum([stratum.thickness for stratum in self.strata])

    # -- runs --------------------------------------------------------------------------------------

    def finite_elements(self, **options) -> mpm.FiniteElements:
        """Elements; ``options`` of ``FiniteElements``."""
        grid = self._grid(0)
        below = self._top(-1)  # cells of a layer are rock, too
        pairs = [(s.law, self._within(k)) for k, s in enumerate(self.strata)]
        pairs[-1] = (pairs[-1][0], lambda x: x[1] < below)
        material = pairs if len(pairs) > 1 else pairs[0][0]
        terms = self.terms(grid, grid.facets("bottom"))
        return mpm.FiniteElements(grid, material, mpm.Newmark(self.step), terms, **options)

    def material_points(self, mapping: mpm.Mapping = mpm.DM_GC, **options) -> mpm.Simulation:
        """Points, 2^dim a cell, on a grid with a cell of room above, and below where the base moves
        up and down; ``options`` of ``Simulation``."""
        grid = self._grid(1)
        bodies = [
            mpm.MaterialPoints.fill(grid, s.law, 2**self.dim, self._within(k))
            for k, s in enumerate(self.strata)
        ]
        terms = self.terms(grid, bodies[-1].surface("bottom"))
        return mpm.Simulation(grid, bodies, mpm.Newmark(self.step), terms, mapping, **options)

    def terms(self, grid: mpm.Grid, bottom) -> list:
        """Sides, damping, and the wave through ``bottom``, facets or surface points."""
        sides = [("left", "right"), ("back", "front")][: self.dim - 1]
        found = [mpm.Tied(*pair) for pair in sides] + self._dampings()
        if self.base == "layer":
            bottom = mpm.AbsorbingLayer("bottom", self.rock)
            found.append(bottom)
        else:
            found.append(mpm.ViscousBoundary(bottom, self.rock))
        wave = mpm.IncidentWave(bottom, self.rock, self.motion, kind=self.kind, wave=self.wave)
        return [*found, wave]

    def probe(self, field: str = "acceleration", depth: float = 0.0) -> mpm.Probe:
        """A recorder at a depth (m), to be given to the run's ``record``."""
        at = [0.5 * self.cell] * self.dim
        at[1] = self.depth - depth
        return mpm.Probe(field, at)

    # -- what is known -----------------------------------------------------------------------------

    def ground(self) -> LayeredGround:
        """The layers at small strain, with their damping."""
        speed = {"SV": "s_speed", "P": "p_speed"}[self.wave]
        layers = [
            Layer(
                thickness=stratum.thickness,
                density=stratum.law.density,
                speed=getattr(stratum.law, speed),
                mass_damping=stratum.damping.alpha if stratum.damping else 0.0,
                stiffness_damping=stratum.damping.beta if stratum.damping else 0.0,
            )
            for stratum in self.strata
        ]
        return LayeredGround(layers, HalfSpace(self.rock.density, getattr(self.rock, speed)))

    def exact(self, times: np.ndarray, field: str = "acceleration", depth: float = 0.0):
        """Exact motion (n,) at a depth (m) at ``times`` (n,), s, of equal steps from 0:
        "acceleration" (m/s²), "velocity" (m/s) or "displacement" (m)."""
        given = self.given(times, field)
        return self.ground().motion_at(depth, given, times[1] - times[0], self.kind)

    def given(self, times: np.ndarray, field: str = "acceleration") -> np.ndarray:
        """The motion that comes in (n,) at ``times`` (n,), s."""
        motion = self.motion.waveform() if hasattr(self.motion, "waveform") else self.motion
        return getattr(motion, field)(times)

    def moved(self, probe: mpm.Probe) -> np.ndarray:
        """What a probe has recorded (n,) of the component that the wave moves."""
        return probe.values[:, DIRECTION[self.wave]]

    def error(self, probe: mpm.Probe) -> float:
        """Of what a probe has recorded, relative to the exact motion at its depth, L2 over time."""
        exact = self.exact(probe.times, probe.field, self.depth - probe.at[1])
        return relative_error(self.moved(probe), exact)

    def equivalent_linear(self, times: np.ndarray, thickest: float = 1.0) -> EquivalentLinear:
        """Linear ground that stands for laws with ``reduction`` and ``damping_ratio``, of layers
        no thicker than ``thickest`` (m), under the motion at ``times`` (n,), s, of equal steps."""
        layers, curves = [], []
        for stratum, layer in zip(self.strata, self.ground().layers, strict=True):
            parts = split([layer], thickest)
            layers += parts
            curves += [stratum.law if hasattr(stratum.law, "reduction") else None] * len(parts)
        ground = LayeredGround(layers, self.ground().base)
        return equivalent_linear(
            ground, curves, self.given(times), times[1] - times[0], kind=self.kind
        )

    # -- parts -------------------------------------------------------------------------------------

    def _grid(self, room: int) -> mpm.Grid:
        """A grid with ``room`` cells above, and below where there is no layer."""
        rows = round(self.depth / self.cell)
        below = 7 if self.base == "layer" else room  # cells of AbsorbingLayer
        low, high = np.zeros(self.dim), np.full(self.dim, self.cell)
        cells = np.ones(self.dim, int)
        low[1], high[1], cells[1] = -below * self.cell, self.depth + room * self.cell, rows
        cells[1] += below + room
        return mpm.Grid.box(tuple(low), tuple(high), tuple(int(n) for n in cells))

    def _top(self, k: int) -> float:
        """Height (m) of the upper end of a stratum."""
        return float(self.bottoms[k] + self.strata[k].thickness)

    def _within(self, k: int):
        """Whether x (dim, n) lies in a stratum: a function."""
        low, high = self.bottoms[k], self._top(k)
        return lambda x: (x[1] > low) & (x[1] < high)

    def _dampings(self) -> list[mpm.RayleighDamping]:
        """A term for each soil that is damped, however many strata it has."""
        laws, found = [], []
        for law, damping in ((s.law, s.damping) for s in self.strata):
            if law not in laws:
                laws.append(law)
                found.append(damping)
            elif found[laws.index(law)] != damping:
                raise ValueError(
                    f"strata of the law {law!r} have two dampings: {damping} and "
                    f"{found[laws.index(law)]}; give them laws that differ"
                )
        return [
            mpm.RayleighDamping(alpha=damping.alpha, beta=damping.beta, material=law)
            for law, damping in zip(laws, found, strict=True)
            if damping is not None
        ]
