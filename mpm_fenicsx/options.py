"""What a run is told, and what it chooses by its scene where it is told nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import Enum

from mpi4py import MPI

from .acceleration_correction import AccelerationCorrection
from .checks import an_object
from .grid import Grid
from .mapping import DM_GC, Mapping
from .points import MaterialPoints
from .projection import DOUBLE_MAPPED
from .time_stepping import Newmark, QuasiStatic

SHORTEST, SHORT = 0.45, 1.0 + 1e-9
"""Courant numbers from which the correction is implicit, and up to which it then goes with two sweeps.

Below the first the matrix of the step is nearly that of mass alone, which in cut cells feeds free bodies (by 2e-3 a
step at Courant 0.1, where lumped mass feeds them by 3e-5, and waves lose little anyway); above the second, two sweeps
feed what crosses cells more than they save of waves (studies/numerical_damping.py)."""

class InitialAcceleration(Enum):
    """The acceleration that a dynamic run starts with, where points or nodes bring none.

    ``BALANCED``: that of the balance of forces at the start, which Newmark's rule is of second order with; ``ZERO``:
    the paper's, with which a load that is there from the start loses half of its first step.
    """

    BALANCED = "balanced"
    ZERO = "zero"


def check_start(initial_acceleration) -> None:
    """Raise ``ValueError`` for what is no ``InitialAcceleration``."""
    an_object("initial_acceleration", initial_acceleration, InitialAcceleration,
              "InitialAcceleration.BALANCED or InitialAcceleration.ZERO")


PAPER = {"mapping": replace(DM_GC, mass=DOUBLE_MAPPED), "sweeps": 0, "correction": AccelerationCorrection.OFF,
         "initial_acceleration": InitialAcceleration.ZERO, "hold_cut_cells": False}
"""Keywords of ``Simulation`` for the step of Do et al. (2023) to the letter, the start included."""


def courant_number(grid: Grid, bodies: Sequence[MaterialPoints], stepping: Newmark | QuasiStatic) -> float:
    """c_p Δt / h of the fastest P wave and the smallest cell; zero where there is no inertia.  Collective."""
    if not stepping.dynamic:
        return 0.0
    extent = (grid.lattice.upper - grid.lattice.lower).min(initial=float("inf"))
    smallest = grid.comm.allreduce(float(extent), op=MPI.MIN)
    return max(body.material.p_speed for body in bodies) * stepping.dt / smallest


def chosen_correction(mapping: Mapping, stepping: Newmark | QuasiStatic, courant: float) -> AccelerationCorrection:
    """In dynamics where points have support domains, implicit, or lumped for the shortest steps; off elsewhere."""
    if not (stepping.dynamic and mapping.support):
        return AccelerationCorrection.OFF
    return AccelerationCorrection.IMPLICIT if courant >= SHORTEST else AccelerationCorrection.LUMPED


def chosen_sweeps(mapping: Mapping, correction: AccelerationCorrection, courant: float) -> int:
    """Two for short steps that are corrected, with integrals at Gauss points; one for others."""
    corrected = correction is AccelerationCorrection.IMPLICIT and mapping.integrate is DOUBLE_MAPPED
    return 2 if corrected and courant <= SHORT else 1
