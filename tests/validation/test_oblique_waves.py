"""Case 9: plane waves meet viscous dashpots aslant; the energy that comes back is that of
``analytical.waves.dashpot_echo``.

Two waves at ±θ together leave the lines x = 0 and x = π/k_x straight and without shear: smooth
walls half a wave apart are the whole plane.  A packet of finite length has a spectrum of angles,
over which the exact answer is averaged.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from methods import POINTS, TILING, over

import mpm_fenicsx as mpm
from mpm_fenicsx.analytical.waves import dashpot_echo
from mpm_fenicsx.mapping.projection import DOUBLE_MAPPED

pytestmark = pytest.mark.validation

TIRES = (
    "the matrix is stiffer than what points give back, and more so as cells lock: loss of energy, "
    "first order in Δt, where accelerations are not corrected"
)
GENTLE = {None: 0.0018, mpm.DM_GC: 0.0011}
STEEP = {None: 0.0085, mpm.DM_C: 0.0103, mpm.DM_GC: 0.0039, mpm.DM_GCL: 0.011}
"""Bounds of the error, at angles up to 40° and at 60°; of the other mappings 0.0105 and 0.0081."""

CELLS = 16  # a wavelength


class Packet:
    """Plane waves of one kind that go down between walls, Gaussian in k_y: displacement, its
    gradient and velocity.

    Lengths in cells, which are 1 m; ``start`` the height of its middle, ``spread`` its length.
    """

    def __init__(self, soil, wave, degrees, start, spread):
        angle, k = np.radians(degrees), 2 * np.pi / CELLS
        self.wave, self.poisson = wave, soil.poisson
        self.speed = soil.p_speed if wave == "P" else soil.s_speed
        self.cells = max(1, round(np.pi / (k * np.sin(angle)))) if degrees else 1
        self.kx = np.pi / self.cells if degrees else 0.0
        centre = self.kx / np.tan(angle) if degrees else k
        self.ky = centre + np.linspace(-3.5, 3.5, 81) / spread
        self.a, self.start = np.exp(-0.5 * ((self.ky - centre) * spread) ** 2), start
        self.ω = self.speed * np.hypot(self.kx, self.ky)

    def echo(self):
        """Part of the energy that comes back."""
        weight = self.a**2 * (self.kx**2 + self.ky**2) ** 2
        angle = np.arctan2(self.kx, self.ky)
        return weight @ [dashpot_echo(θ, self.poisson, self.wave) for θ in angle] / weight.sum()

    def at(self, x):
        """Displacement (n, 2), its gradient (n, 2, 2), velocity, acceleration at time 0; waves
        cos(k_y y + ωt)."""
        phase = np.outer(x[:, 1] - self.start, self.ky)
        c, s = self.a * np.cos(phase), self.a * np.sin(phase)
        X = np.cos(self.kx * x[:, 0])
        Y = np.sin(self.kx * x[:, 0])
        kx = self.kx
        ky = self.ky
        ω = self.ω
        if self.wave == "P":  # the gradient of cos kx x cos(...)

            def field(c, s):
                return np.stack((-kx * Y * c.sum(1), -X * (s @ ky)), 1)

            gradient = [
                [-(kx**2) * X * c.sum(1), kx * Y * (s @ ky)],
                [kx * Y * (s @ ky), -X * (c @ ky**2)],
            ]
        else:  # the curl of sin kx x cos(...), for normal incidence of cos kx x cos(...)
            S, C, sign = (Y, X, kx) if kx else (X, Y, 0.0)

            def field(c, s):
                return np.stack((-S * (s @ ky), -sign * C * c.sum(1)), 1)

            gradient = [
                [-sign * C * (s @ ky), -S * (c @ ky**2)],
                [sign**2 * S * c.sum(1), sign * C * (s @ ky)],
            ]
        v, a = field(-ω * s, ω * c), field(-(ω**2) * c, -(ω**2) * s)
        return field(c, s), np.moveaxis(np.array(gradient), -1, 0), v, a


def sent(mapping, wave, degrees, poisson, courant=0.5, b_bar=False):
    """The packet as it is sent down: the run, its energy, the packet, and how long until what comes
    back is up."""
    soil, spread = mpm.LinearElastic(20e6, poisson, 1500.0), 0.8 * CELLS
    packet = Packet(soil, wave, degrees, 4 * spread, spread)
    height = round(12 * spread)
    wait = 7 if degrees > 50 else 5  # the shallow waves of the packet come late
    side = "y" if wave == "S" and not degrees else "x"
    stepping = mpm.Newmark(courant / packet.speed)
    size = 1e-6
    if mapping is None:
        grid = mpm.Grid.box((0, 0), (packet.cells, height), (packet.cells, height))
        terms = [
            mpm.Fixed(grid.facets("left", "right"), side),
            mpm.ViscousBoundary(grid.facets("bottom"), soil),
        ]
        run = mpm.FiniteElements(grid, soil, stepping, terms, b_bar=b_bar)
        u, _, v, a = packet.at(grid.space.tabulate_dof_coordinates()[:, :2])
        for name, value in (("displacement", u), ("velocity", v), ("acceleration", a)):
            run.nodal(name)[:] = size * value
    else:
        grid = mpm.Grid.box((0, -2), (packet.cells, height), (packet.cells, height + 2))
        body = mpm.MaterialPoints.fill(grid, soil, 4, inside=lambda x: x[1] > 0)
        _, gradient, v, a = packet.at(body.x)
        strain = 0.5 * size * (gradient + gradient.transpose(0, 2, 1))
        rows = np.zeros_like(body.stress)
        rows[:, 0], rows[:, 1], rows[:, 3] = strain[:, 0, 0], strain[:, 1, 1], 2 * strain[:, 0, 1]
        body.stress = soil.update(rows, body.stress)
        body.velocity, body.acceleration = size * v, size * a
        run = mpm.Simulation(
            grid,
            body,
            stepping,
            [
                mpm.Fixed(grid.facets("left", "right"), side),
                mpm.ViscousBoundary(body.surface("bottom"), soil),
            ],
            replace(mapping, b_bar=b_bar),
        )
    way = packet.start + wait * spread
    return run, run.record(mpm.Energy()), packet, way / packet.speed / np.cos(np.radians(degrees))


def energy_back(*scene, **keywords):
    """Part of the energy left when the packet has gone down and what comes back has gone up; and
    the exact one."""
    run, energy, packet, time = sent(*scene, **keywords)
    for _ in range(int(time / run.stepping.dt)):
        run.step()
    return energy.left[-1] / energy.left[0], packet.echo()


@pytest.mark.parametrize("wave", ["P", "S"])
@pytest.mark.parametrize(
    "mapping, steep, poisson",
    product((None, *POINTS), (False, True), (0.25, 0.41)),
    ids=str,
)
def test_energy_that_comes_back(mapping, steep, poisson, wave, record):
    """The error is a part of the energy that arrived; of angles up to 40° the largest.

    Linear weights are as good here: the light nodes below an edge a hair past a grid line follow
    the body, where a third of the energy came back while they were on their own.  At 60° and ν =
    0.25 more comes back than should, 0.35 % with DM-GC and 0.7 % with GIMP, as of finite elements:
    the losses that had covered up for it are gone.
    """
    angles = (
        (60,)
        if steep
        else (0, 20, 40)
        if mapping in (None, mpm.DM_GC) and poisson == 0.25
        else (40,)
    )
    error = max(
        abs(np.subtract(*energy_back(mapping, wave, degrees, poisson))) for degrees in angles
    )
    case = (
        f"9 {wave} waves on dashpots, ν = {poisson:g}, {'60' if steep else 'up to 40'}°: energy "
        "back"
    )
    uncorrected = mapping in (mpm.CMPM, mpm.DM_C, mpm.DM_GCL)
    tired = uncorrected and wave == "S" and poisson == 0.41
    record(case, mapping, error, TIRES if tired else "")
    if tired:
        assert 0.0015 < error < (0.031 if steep else 0.0035)
    else:
        assert error < (STEEP.get(mapping, 0.0081) if steep else GENTLE.get(mapping, 0.0105))


@over(None, *(mapping for mapping in POINTS if mapping.integrate is DOUBLE_MAPPED))
def test_b_bar_brings_shear_waves_back(mapping, record):
    error = abs(np.subtract(*energy_back(mapping, "S", 60, 0.41, b_bar=True)))
    record("9 S waves on dashpots, ν = 0.41, 60°, B-bar: energy back", mapping, error)
    assert error < 0.006


@over(*TILING)
def test_a_correction_by_lumped_mass_brings_shear_waves_back(mapping, record):
    """Here, where P waves are at Courant 1.3, the default is the implicit correction, and DM-GCL's
    none: this is the other one, with DM-GC and DM-GCL to the exact echo, 11.9 %; those of linear
    strain are 0.3 % off for their dispersion."""
    error = abs(
        np.subtract(
            *energy_back(
                replace(mapping, correction=mpm.AccelerationCorrection.LUMPED), "S", 60, 0.41
            )
        )
    )
    record("9 S waves on dashpots, ν = 0.41, 60°, lumped correction: energy back", mapping, error)
    assert error < (0.0003 if mapping.composite else 0.0029)


def test_what_shear_waves_lose_aslant_is_of_first_order_in_the_step_and_of_locking():
    """Over a way of 10 cells, before they come to the dashpots: 3 % where accelerations are not
    corrected, with DM-GCL or by request; with B-bar a sixth of it.

    The correction leaves DM-GC a tenth.  Plain MPM, while no point crosses a cell, has the matrix
    of its force: it loses what a sweep leaves of averaging, 0.05 %.
    """

    def lost(mapping, courant=0.5, **keywords):
        run, energy, _, _ = sent(mapping, "S", 60, 0.41, courant, **keywords)
        for _ in range(round(20 / courant)):
            run.step()
        return 1 - energy.left[-1] / energy.left[0]

    linear = lost(mpm.DM_GCL)
    off = replace(mpm.DM_GC, correction=mpm.AccelerationCorrection.OFF)
    assert 0.02 < linear < 0.033
    assert lost(off) == pytest.approx(linear, rel=0.01)
    assert lost(mpm.DM_GCL, 0.25) / linear == pytest.approx(0.5, rel=0.1)
    assert lost(mpm.DM_GCL, b_bar=True) < linear / 5
    assert 0.0 < lost(mpm.DM_GC) < linear / 10
    assert 0.0 < lost(mpm.MPM) < linear / 50
