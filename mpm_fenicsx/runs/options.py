"""What a run is told, and what it chooses by its scene where it is told nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import Enum

from mpi4py import MPI

from ..common.checks import an_object
from ..dynamics.time_stepping import Newmark, QuasiStatic
from ..grid.grid import Grid
from ..mapping.methods import DM_GC, Mapping
from ..mapping.projection import DOUBLE_MAPPED
from ..points.material_points import MaterialPoints
from ..solver.acceleration_correction import AccelerationCorrection

SHORT = 1.0 + 1e-9
"""Courant number up to which the correction is by lumped mass, and from which it is implicit.

Below, both keep waves alike and the lumped one costs less; the matrix of a very short step is that
of mass alone, which feeds free bodies whose ends are cut (by 2e-3 a step at Courant 0.1; lumped
mass by 3e-5).  Above, lumped mass feeds bars off the grid's lines (by 6e-3 a step at Courant 10),
the matrix of the step none (studies/numerical_damping.py)."""


class InitialAcceleration(Enum):
    """The acceleration that a dynamic run starts with, where points or nodes bring none.

    ``BALANCED``: that of the balance of forces at the start, which Newmark's rule is of second
    order with; ``ZERO``: the paper's, with which a load that is there from the start loses half of
    its first step.
    """

    BALANCED = "balanced"
    ZERO = "zero"


def check_start(initial_acceleration) -> None:
    """Raise ``ValueError`` for what is no ``InitialAcceleration``."""
    an_object(
        "initial_acceleration",
        initial_acceleration,
        InitialAcceleration,
        "InitialAcceleration.BALANCED or InitialAcceleration.ZERO",
    )


PAPER = {
    "mapping": replace(DM_GC, mass=DOUBLE_MAPPED),
    "sweeps": 0,
    "correction": AccelerationCorrection.OFF,
    "initial_acceleration": InitialAcceleration.ZERO,
    "hold_cut_cells": False,
}
"""Keywords of ``Simulation`` for the step of Do et al. (2023) to the letter, the start included."""


def courant_number(
    grid: Grid, bodies: Sequence[MaterialPoints], stepping: Newmark | QuasiStatic
) -> float:
    """c_p Δt / h of the fastest P wave and the smallest cell; zero where there is no inertia.
    Collective."""
    if not stepping.dynamic:
        return 0.0
    extent = (grid.lattice.upper - grid.lattice.lower).min(initial=float("inf"))
    smallest = grid.comm.allreduce(float(extent), op=MPI.MIN)
    return max(body.material.p_speed for body in bodies) * stepping.dt / smallest


def chosen_correction(
    mapping: Mapping, stepping: Newmark | QuasiStatic, courant: float
) -> AccelerationCorrection:
    """Lumped for short steps and implicit for others, in dynamics where points have support
    domains; off elsewhere.

    Off, too, where stress is linear over domains: that force is not the adjoint of the strain, and
    bodies that meet gain energy with it.
    """
    if not (stepping.dynamic and mapping.support) or mapping.linear:
        return AccelerationCorrection.OFF
    return AccelerationCorrection.LUMPED if courant <= SHORT else AccelerationCorrection.IMPLICIT
