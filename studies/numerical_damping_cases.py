"""What ``numerical_damping.py`` measures: what waves lose, what grows, what a step costs.

A variant is a mapping, or ``None`` for finite elements, and a change that is made to its runs once
they are built, mostly none.  Nothing acts at the start: its acceleration is zero, as the paper has
it, and that of the balance alike.
"""

from __future__ import annotations

from collections.abc import Callable

import cost_scenes
import numpy as np
from amplification_map import StepMap, crossing, growth
from cost_of_a_step import spread, taking_turns
from cost_pieces import Bill

from mpm_fenicsx import Energy, FiniteElements, Mapping, Simulation
from mpm_fenicsx.scenes.block import bar, block, step_of
from mpm_fenicsx.scenes.wave import Wave, soil

SETTLING = 0.5  # periods that are left out of the fit: points' accelerations find their size there
LEAST = 40  # steps that are fitted at least
# of the energy: what is left then, points keep for good, in velocities that no node sees
ENOUGH = 0.05

Change = Callable[[Simulation], Simulation]


def as_it_is(run: Simulation) -> Simulation:
    """No change."""
    return run


# -- standing waves --------------------------------------------------------------------------------


def standing(
    wave: Wave, mapping: Mapping | None, change: Change = as_it_is
) -> Simulation | FiniteElements:
    """A run of the wave, finite elements where ``mapping`` is None."""
    return wave.finite_elements() if mapping is None else change(wave.material_points(mapping))


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
    wave: Wave, mapping: Mapping | None, change: Change = as_it_is, periods: float = 3.0
) -> dict:
    """Equivalent damping ratio (%) of a wave, and the cells a wavelength that it has."""
    times, energy = energies(standing(wave, mapping, change), periods, wave.period)
    return {
        "damping": 100 * damping_ratio(times, energy, wave.period),
        "cells_exact": 2 * np.pi / wave.number,
    }


def damping_far(wave: Wave, mapping: Mapping | None, change: Change = as_it_is) -> dict:
    """The same (%) far from walls: what boxes of one and two lengths leave, ζ = ζ_far + ζ_walls /
    length."""
    twice = Wave(
        wave.kind, wave.direction, wave.poisson, wave.cells, wave.courant, 2 * wave.half_waves
    )
    found, more = damping(wave, mapping, change), damping(twice, mapping, change)
    if abs(more["cells_exact"] / found["cells_exact"] - 1.0) > 1e-9:
        raise ValueError(f"the wavelength of {twice} is not that of {wave}")
    return {**found, "damping": 2 * more["damping"] - found["damping"]}


# -- growth ----------------------------------------------------------------------------------------


def growth_at_rest(
    scene: str,
    poisson: float,
    courant: float,
    offset: float,
    mapping: Mapping,
    change: Change = as_it_is,
) -> dict:
    """Largest |λ| - 1 a step of a free bar of 12 cells, or block of 4 by 3, ``offset`` cells off
    the grid lines."""
    build, material = {"bar": bar, "block": block}[scene], soil(poisson)
    run = build(mapping, step_of(courant, material), offset=offset, material=material)
    return {"growth": growth(StepMap(change(run)).matrix, courant)["growth"]}


def growth_crossing(
    poisson: float, courant: float, mapping: Mapping, change: Change = as_it_is, cells: int = 8
) -> dict:
    """The same a step, of a free bar that moves 0.3 cells in each: the product of ten."""
    material = soil(poisson)
    T = crossing(mapping, step_of(courant, material), cells=cells, material=material, change=change)
    return {"growth": growth(T, courant, 10)["growth"]}


# -- cost ------------------------------------------------------------------------------------------


def cost(
    variants: dict[str, Mapping],
    changes: dict[str, Change],
    reference: str,
    cell: float,
    rounds: int,
) -> dict[str, dict]:
    """Seconds a step of each variant over those of one of them, taking turns on the strip of
    ``cost_scenes``: median, and quartiles."""
    bills = {}
    for name, mapping in variants.items():
        run = cost_scenes.scene("DM-GC", 2, cell, mapping=mapping)
        bills[name] = Bill(changes.get(name, as_it_is)(run))
    seconds = taking_turns(bills, rounds)
    return {
        name: {
            "ratio": spread(own / seconds[reference]),
            "seconds": float(np.median(own)),
            "iterations": bills[name].run.equilibrium.iterations,
        }
        for name, own in seconds.items()
    }
