"""What ``numerical_damping.py`` measures: what waves lose, what grows, what a step costs.

A variant is the keyword arguments of ``Simulation`` that make it, or ``None`` for finite elements,
and a change that is made to its runs once they are built, mostly none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cost_scenes
import numpy as np
from amplification_map import StepMap, bar, block, crossing, growth, step_of
from cost_of_a_step import spread, taking_turns
from cost_pieces import Bill

from mpm_fenicsx import (
    DM_GC,
    Energy,
    FiniteElements,
    Fixed,
    Grid,
    LinearElastic,
    MaterialPoints,
    Newmark,
    Simulation,
)

YOUNG, DENSITY = 20e6, 1500.0  # Pa, kg/m³; only Poisson's ratio and the Courant number matter
AMPLITUDE = 1e-6  # m/s, in cells of 1 m: points move by 1e-7 of a cell at most
SETTLING = 0.5  # periods that are left out of the fit: points' accelerations find their size there
LEAST = 40  # steps that are fitted at least
# of the energy: what is left then, points keep for good, in velocities that no node sees
ENOUGH = 0.05

Change = Callable[[Simulation], Simulation]


def as_it_is(run: Simulation) -> Simulation:
    """No change."""
    return run


def soil(poisson: float) -> LinearElastic:
    """Elastic soil of some Poisson's ratio."""
    return LinearElastic(YOUNG, poisson, DENSITY)


# -- standing waves --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Wave:
    """A standing wave in a box of cells of 1 m between smooth walls, an exact mode of the elastic
    body.

    Along an axis, with k = 2π/λ and rollers where the motion is along the wall or none:

        P  v = (sin kx, 0)    u_x = 0 at x = 0, L;    u_y = 0 below and above
        S  v = (0, sin kx)    u_y = 0 at x = 0, L;    u_x = 0 below and above

    On the diagonal, with rollers all round, the sum of two plane waves along (1, ±1) and so of K =
    k√2, λ = 2π/K:

        P  v = (sin kx cos ky, cos kx sin ky)     curl v = 0
        S  v = (sin kx cos ky, -cos kx sin ky)    div v = 0

    Each gives ρ ∂²v/∂t² = -ρ K²c² v with the P or S wave's speed c, no normal velocity and no shear
    at a roller, so that T = 2π/(K c).  The rollers along an axis bear σ_xx or σ_yy = λ ∂u_x/∂x, and
    leave the rest free of stress.

    ``kind``: "P" or "S"; ``direction``: "axis" or "diagonal"; ``poisson``; ``cells`` a wavelength,
    on the diagonal the nearest that fits; ``courant`` number of the P wave; ``half_waves`` in the
    box, by default 4 along an axis, or 1 each way on the diagonal.
    """

    kind: str
    direction: str
    poisson: float
    cells: int
    courant: float
    half_waves: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "half_waves", self.half_waves or (1 if self.diagonal else 4))

    @property
    def diagonal(self) -> bool:
        """Whether it runs across the cells."""
        return self.direction == "diagonal"

    @property
    def length(self) -> int:
        """Cells of the box along x."""
        return round(self.half_waves * self.cells / (np.sqrt(2) if self.diagonal else 2))

    @property
    def k(self) -> float:
        """Wave number along x (1/m)."""
        return self.half_waves * np.pi / self.length

    @property
    def number(self) -> float:
        """Wave number K (1/m)."""
        return self.k * np.sqrt(2) if self.diagonal else self.k

    @property
    def period(self) -> float:
        """Exact period T (s)."""
        material = soil(self.poisson)
        return (
            2 * np.pi / (self.number * (material.s_speed if self.kind == "S" else material.p_speed))
        )

    @property
    def dt(self) -> float:
        """Step (s)."""
        return self.courant / soil(self.poisson).p_speed

    def velocity(self, x: np.ndarray) -> np.ndarray:
        """The mode (n, 2), m/s, at places x (n, 2)."""
        a, b = (self.k * x[:, d] for d in range(2))
        if self.diagonal:
            sign = -1.0 if self.kind == "S" else 1.0
            v = np.sin(a) * np.cos(b), sign * np.cos(a) * np.sin(b)
        else:
            v = (np.sin(a), 0.0 * a) if self.kind == "P" else (0.0 * a, np.sin(a))
        return AMPLITUDE * np.stack(v, axis=1)

    def grid_and_walls(self) -> tuple[Grid, list[Fixed]]:
        """Along an axis the box is a cell wide, for nothing changes across it."""
        size = (self.length, self.length if self.diagonal else 1)
        grid = Grid.box((0, 0), size, size)
        ends, sides = grid.facets("left", "right"), grid.facets("bottom", "top")
        across = not self.diagonal and self.kind == "S"
        return grid, [Fixed(ends, "xy"[across]), Fixed(sides, "yx"[across])]


def standing(
    wave: Wave, options: Mapping | None, change: Change = as_it_is
) -> Simulation | FiniteElements:
    """A run that begins with the mode's velocity, without stress."""
    grid, walls = wave.grid_and_walls()
    if options is None:
        run = FiniteElements(grid, soil(wave.poisson), Newmark(wave.dt), walls)
        nodal = run.motion.nodal(run.motion.v)
        nodal[:] = wave.velocity(grid.space.tabulate_dof_coordinates()[: len(nodal)])
        return run
    body = MaterialPoints.fill(grid, soil(wave.poisson), 4)
    body.velocity = wave.velocity(body.x)
    return change(Simulation(grid, body, Newmark(wave.dt), walls, **options))


def energies(
    run: Simulation | FiniteElements, periods: float, period: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and energies (J), kinetic and strain, of so many periods after the settling, or of
    ``LEAST`` steps."""
    energy, dt = run.record(Energy()), run.stepping.dt
    steps = int(np.ceil(SETTLING * period / dt)) + max(int(np.ceil(periods * period / dt)), LEAST)
    for _ in range(steps):
        run.step()
    return energy.times, energy.left


def damping_ratio(times: np.ndarray, energy: np.ndarray, period: float) -> float:
    """ζ = -(d ln E/dt) T/4π of a vibration's energy (n,) at equally spaced times (n,), s.

    Points do not measure kinetic and strain energy alike, by up to 1 %, so that E swings as one
    becomes the other, by more than a period takes of it.  So the line is fitted together with the
    swing and its second harmonic,

        ln E = a - 4πζ t/T + Σ_j (b_j cos 2jωt + c_j sin 2jωt),  j = 1, 2

    at the ω that fits best around that of the trapezoidal rule, tan(ωΔt/2) = πΔt/T, for space
    changes it as well; with fewer than six steps a period the second harmonic is left out, which
    cannot be told from a constant near four.
    """
    dt = (times[1] - times[0]) / period
    gone = np.flatnonzero(energy < ENOUGH * energy[0])
    end = max(gone[0], int(SETTLING / dt) + LEAST // 2) if len(gone) else len(energy)
    kept = (times >= SETTLING * period) & (np.arange(len(times)) < end)
    expected = 2 / dt * np.arctan(np.pi * dt)
    harmonics = (1, 2) if expected * dt < np.pi / 3 else (1,)
    t, logarithm = times[kept] / period, np.log(energy[kept] / energy[0])

    def fit(ω: float) -> tuple[float, float]:
        swing = [f(2 * j * ω * t) for j in harmonics for f in (np.cos, np.sin)]
        terms = np.stack([np.ones_like(t), t, *swing], axis=1)
        found = np.linalg.lstsq(terms, logarithm, rcond=None)[0]
        return float(np.square(terms @ found - logarithm).sum()), float(found[1])

    tried = expected * np.linspace(0.7, 1.2, 201)
    best = int(np.argmin([fit(ω)[0] for ω in tried]))
    low, high = tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)]
    for _ in range(40):  # ternary search
        left, right = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, right) if fit(left)[0] < fit(right)[0] else (left, high)
    return -fit(0.5 * (low + high))[1] / (4 * np.pi)


def damping(
    wave: Wave, options: Mapping | None, change: Change = as_it_is, periods: float = 3.0
) -> dict:
    """Equivalent damping ratio (%) of a wave, and the cells a wavelength that it has."""
    times, energy = energies(standing(wave, options, change), periods, wave.period)
    return {
        "damping": 100 * damping_ratio(times, energy, wave.period),
        "cells_exact": 2 * np.pi / wave.number,
    }


def damping_far(wave: Wave, options: Mapping | None, change: Change = as_it_is) -> dict:
    """The same (%) far from walls: what boxes of one and two lengths leave, ζ = ζ_far + ζ_walls /
    length."""
    twice = Wave(
        wave.kind, wave.direction, wave.poisson, wave.cells, wave.courant, 2 * wave.half_waves
    )
    found, more = damping(wave, options, change), damping(twice, options, change)
    if abs(more["cells_exact"] / found["cells_exact"] - 1.0) > 1e-9:
        raise ValueError(f"the wavelength of {twice} is not that of {wave}")
    return {**found, "damping": 2 * more["damping"] - found["damping"]}


# -- growth ----------------------------------------------------------------------------------------


def growth_at_rest(
    scene: str,
    poisson: float,
    courant: float,
    offset: float,
    options: Mapping,
    change: Change = as_it_is,
) -> dict:
    """Largest |λ| - 1 a step of a free bar of 12 cells, or block of 4 by 3, ``offset`` cells off
    the grid lines."""
    build, options, material = {"bar": bar, "block": block}[scene], dict(options), soil(poisson)
    mapping = options.pop("mapping", DM_GC)
    run = build(mapping, step_of(courant, material), offset=offset, material=material, **options)
    return {"growth": growth(StepMap(change(run)).matrix, courant)["growth"]}


def growth_crossing(
    poisson: float, courant: float, options: Mapping, change: Change = as_it_is, cells: int = 8
) -> dict:
    """The same a step, of a free bar that moves 0.3 cells in each: the product of ten."""
    options, material = dict(options), soil(poisson)
    mapping = options.pop("mapping", DM_GC)
    T = crossing(
        mapping,
        step_of(courant, material),
        cells=cells,
        material=material,
        change=change,
        **options,
    )
    return {"growth": growth(T, courant, 10)["growth"]}


# -- cost ------------------------------------------------------------------------------------------


def cost(
    variants: Mapping[str, Mapping],
    changes: Mapping[str, Change],
    reference: str,
    cell: float,
    rounds: int,
) -> dict[str, dict]:
    """Seconds a step of each variant over those of one of them, taking turns on the strip of
    ``cost_scenes``: median, and quartiles."""
    bills = {
        name: Bill(changes.get(name, as_it_is)(cost_scenes.scene("DM-GC", 2, cell, **options)))
        for name, options in variants.items()
    }
    seconds = taking_turns(bills, rounds)
    return {
        name: {
            "ratio": spread(own / seconds[reference]),
            "seconds": float(np.median(own)),
            "iterations": bills[name].run.equilibrium.iterations,
        }
        for name, own in seconds.items()
    }
