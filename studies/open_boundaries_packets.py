"""Packets of plane waves that meet a boundary of the grid, and the energy that comes back.

A packet is Gaussian along its way and across it, and made of the grid's own plane waves: each goes
on for ever in an unbounded grid, with the frequency that Newmark's trapezoidal rule gives it, so
that the packet there is known at any time by a Fourier transform.  What a run has beyond it has
come back from the boundary.

Cells are 1 m, c_s = ρ = 1; the boundary is the bottom, y = 0, the normal of which angles (rad) are
measured from.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical.reflection import Dashpots, LayerCells, reflected_energy
from mpm_fenicsx.analytical.waves import dashpot_echo
from mpm_fenicsx.terms.layer_cells import default_cells

CELLS = 16  # a wavelength
ALONG, ACROSS = 1.5 * CELLS, 2.0 * CELLS
"""Standard deviations of the packet's amplitude, m."""
COURANT = 2.0
"""Of the packet's speed; it changes frequencies, and nothing that comes back."""
AWAY = 3.5
"""Standard deviations of amplitude between the packet's middle and what it should not touch."""


def soil_of(poisson: float) -> mpm.LinearElastic:
    """Soil with c_s = ρ = μ = 1."""
    return mpm.LinearElastic(young=2 * (1 + poisson), poisson=poisson, density=1.0)


def dispersion(soil, wave: str, kx: np.ndarray, ky: np.ndarray) -> tuple[np.ndarray, ...]:
    """Ω (1/s), polarisation (2, ...) and mass of plane waves on a grid of square bilinear cells.

    Ω = (2/Δt) tan(ωΔt/2), so that v = −iΩu and a = −Ω²u under the trapezoidal rule.
    """
    λ, μ = soil.lame
    mx, my = (2 + np.cos(kx)) / 3, (2 + np.cos(ky)) / 3
    sx, sy = (2 - 2 * np.cos(kx)) * my, (2 - 2 * np.cos(ky)) * mx
    xx, yy = (λ + 2 * μ) * sx + μ * sy, (λ + 2 * μ) * sy + μ * sx
    xy = (λ + μ) * np.sin(kx) * np.sin(ky)
    mass = soil.density * mx * my
    mean, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    fast = 0.5 * np.arctan2(2 * xy, xx - yy)  # of the axis of the stiffer wave
    d = np.array([np.cos(fast), np.sin(fast)])
    d = d * np.where(kx * d[0] + ky * d[1] < 0, -1.0, 1.0)
    if wave == "S":
        return np.sqrt(np.maximum(mean - half, 0.0) / mass), np.array([-d[1], d[0]]), mass
    return np.sqrt((mean + half) / mass), d, mass


@dataclass(frozen=True)
class Packet:
    """P or S ``wave``, which comes down and to the right at ``degrees`` from the normal and is
    aimed at the bottom of a body with free edges else."""

    wave: str
    degrees: float
    poisson: float = 0.25

    @property
    def soil(self) -> mpm.LinearElastic:
        """The ground."""
        return soil_of(self.poisson)

    @property
    def speed(self) -> float:
        """Of the wave, m/s."""
        return self.soil.p_speed if self.wave == "P" else self.soil.s_speed

    @property
    def dt(self) -> float:
        """A step, s."""
        return COURANT / self.speed

    @property
    def way(self) -> np.ndarray:
        """Direction (2,) of the packet."""
        return np.array([np.sin(np.radians(self.degrees)), -np.cos(np.radians(self.degrees))])

    @property
    def spread(self) -> np.ndarray:
        """Standard deviations (2,) of the amplitude in x and y, m."""
        return np.hypot(ALONG * self.way, ACROSS * self.way[::-1])

    @property
    def start(self) -> np.ndarray:
        """Middle (2,) of the packet at time 0."""
        y = AWAY * self.spread[1]
        return np.array([AWAY * self.spread[0], y])

    @property
    def meets(self) -> float:
        """x where its middle comes to the bottom."""
        return self.start[0] + self.start[1] * np.tan(np.radians(self.degrees))

    @property
    def cells(self) -> tuple[int, int]:
        """Of the body: room for the packet on its way down, and for what comes back; a P wave that
        an S wave makes goes further to the right, up to the critical angle and a little beyond."""
        sine, fast = np.sin(np.radians(self.degrees)), self.soil.p_speed / self.speed
        along = sine  # m in the time of a metre of the packet
        if fast * sine < 1.3:
            along = max(along, fast * min(1.0, fast * sine))
        right = along * self.start[1] / np.cos(np.radians(self.degrees))
        wide = self.meets + right + AWAY * self.spread[0]
        return round(wide), round(2 * AWAY * self.spread[1])

    @property
    def steps(self) -> int:
        """Until the packet, with its speed on the grid, is as far below the bottom as it was above
        at the start."""
        k = 2 * np.pi / CELLS * (1 + np.array([-1e-4, 1e-4]))
        Ω = dispersion(self.soil, self.wave, *(k * d for d in self.way))[0]
        group = np.diff(2 * np.arctan(0.5 * Ω * self.dt)) / np.diff(k)  # m a step
        return round(2 * self.start[1] / np.cos(np.radians(self.degrees)) / group.item())

    @cached_property
    def spectrum(self) -> tuple[np.ndarray, ...]:
        """kx, ky, amplitude (complex, of waves at time 0), Ω, polarisation, mass; all on a grid."""
        wide, high = self.cells
        shape = 2 ** np.ceil(np.log2([1.3 * wide, 2.2 * high])).astype(int)
        kx, ky = np.meshgrid(*(2 * np.pi * np.fft.fftfreq(n) for n in shape), indexing="ij")
        k, (x, y) = 2 * np.pi / CELLS, self.way
        along, across = kx * x + ky * y - k, ky * x - kx * y
        amplitude = np.exp(-0.5 * ((ALONG * along) ** 2 + (ACROSS * across) ** 2))
        amplitude = amplitude * np.exp(-1j * (kx * self.start[0] + ky * self.start[1]))
        return (kx, ky, amplitude, *dispersion(self.soil, self.wave, kx, ky))

    def at(self, steps: int, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """Displacement, velocity, acceleration (n, 2) at nodes ``x`` (n, 2) of the unbounded grid
        after so many steps."""
        _, _, amplitude, Ω, d, _ = self.spectrum
        turned = amplitude * np.exp(-2j * np.arctan(0.5 * Ω * self.dt) * steps)
        i, j = np.rint(x).astype(int).T
        size = 1e-3 / abs(amplitude).sum() * amplitude.size
        found = []
        for factor in (1.0, -1j * Ω, -(Ω**2)):
            fields = (np.fft.ifft2(size * factor * turned * one).real for one in d)
            found.append(np.stack([field[i, j] for field in fields], axis=1))
        return tuple(found)

    def mean(self, share, points: int = 21) -> float:
        """Mean of ``share(angle, cells a wavelength)`` over the packet's energy."""
        k = 2 * np.pi / CELLS
        s = np.linspace(-3.3, 3.3, points)
        along, across = (one.ravel() for one in np.meshgrid(k + s / ALONG, s / ACROSS))
        (x, y), total, weights = self.way, 0.0, 0.0
        for a, c in zip(along, across, strict=True):
            kx, ky = a * x - c * y, a * y + c * x
            Ω, _, mass = dispersion(self.soil, self.wave, np.array(kx), np.array(ky))
            weight = np.exp(-((ALONG * (a - k)) ** 2) - (ACROSS * c) ** 2) * Ω**2 * mass
            angle = np.arctan2(abs(kx), -ky)
            if angle < np.radians(89.5):  # others do not come to the bottom
                total += weight * share(angle, 2 * np.pi / np.hypot(kx, ky))
            weights += weight
        return float(total / weights)

    def expected(self, boundary: Dashpots | LayerCells) -> float:
        """Share of the packet's energy that comes back, exact for the grid."""
        return self.mean(
            lambda angle, cells: reflected_energy(self.soil, self.wave, angle, cells, boundary)
        )

    def expected_of_ground(self) -> float:
        """The same of dashpots on a continuous ground (Lysmer & Kuhlemeyer 1969)."""
        return self.mean(lambda angle, _: dashpot_echo(angle, self.poisson, self.wave))


def layer(soil, absorbing: int = 3, elastic: int = 4) -> LayerCells:
    """The cells of ``AbsorbingLayer``, 1 m each, for the exact theory."""
    return LayerCells(default_cells(soil, 1.0, absorbing, elastic))


def energy_back(packet: Packet, layer: mpm.AbsorbingLayer | None) -> dict[str, float]:
    """Shares of the packet's energy: ``back``, what came back from the bottom; ``left``, what is
    in the body, the packet's own tail included.

    Finite elements; the layer, or dashpots, at bottom and right, the top and the left are free.
    """
    soil, (wide, high) = packet.soil, packet.cells
    thick = layer.thickness if layer else 0
    grid = mpm.Grid.box((0, -thick), (wide + thick, high), (wide + thick, high + thick))
    sides = grid.facets("bottom", "right")
    terms = [layer] if layer else [mpm.ViscousBoundary(sides, soil)]
    run = mpm.FiniteElements(grid, soil, mpm.Newmark(packet.dt), terms)
    x = grid.space.tabulate_dof_coordinates()[:, :2]
    body = np.flatnonzero((x[:, 0] < wide + 0.5) & (x[:, 1] > -0.5))
    names = ("displacement", "velocity", "acceleration")

    def energy() -> float:
        found = run.energy()
        return found["kinetic"] + found["strain"]

    for name, value in zip(names, packet.at(0, x[body]), strict=True):
        run.nodal(name)[body] = value
    came = energy()
    for _ in range(packet.steps):
        run.step()
    left = energy()
    for name, value in zip(names, packet.at(packet.steps, x[body]), strict=True):
        run.nodal(name)[body] -= value
    return {"back": energy() / came, "left": left / came}


def measured(wave: str, degrees: float, poisson: float, absorbing: int) -> dict[str, object]:
    """A packet on a layer of so many absorbing cells and four elastic ones, or on dashpots where
    there are none: what comes back, and what the theory says."""
    packet = Packet(wave, degrees, poisson)
    soil = packet.soil
    if absorbing:
        name, cells = f"layer, {absorbing} cells", layer(soil, absorbing)
        term = mpm.AbsorbingLayer(("bottom", "right"), soil, absorbing)
    else:
        name, cells, term = "dashpots", Dashpots(), None
    began = time.process_time()
    row = {
        "wave": wave,
        "degrees": degrees,
        "poisson": poisson,
        "boundary": name,
        **energy_back(packet, term),
        "expected": packet.expected(cells),
    }
    if not absorbing:
        row["expected_of_ground"] = packet.expected_of_ground()
    wide, high = packet.cells
    return {
        **row,
        "cells": wide * high,
        "steps": packet.steps,
        "seconds": round(time.process_time() - began, 1),
    }
