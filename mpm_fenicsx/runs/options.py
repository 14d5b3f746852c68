"""What a run is told, and what it chooses by its scene where it is told nothing."""

from __future__ import annotations

import warnings
from collections.abc import Mapping as Options
from collections.abc import Sequence
from dataclasses import fields, replace
from enum import Enum

import numpy as np

from ..common.checks import an_object, in_short
from ..common.ranks import warn
from ..dynamics.time_stepping import Newmark, QuasiStatic
from ..grid import dolfinx_versions
from ..grid.grid import Grid
from ..mapping.methods import DM_GC, AccelerationCorrection, Mapping
from ..mapping.projection import DOUBLE_MAPPED
from ..points.material_points import MaterialPoints
from ..solver.newton import Newton
from ..solver.solver import Solver

UNLIKELY = 100.0
"""Courant number from which a step is doubted."""
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


def choices(mapping: Mapping) -> dict[str, str]:
    """What a mapping is made of, by name, in words."""
    found = {}
    for field in fields(mapping):
        value = getattr(mapping, field.name)
        if isinstance(value, Enum):
            value = value.value
        found[field.name] = str(getattr(value, "__name__", None) or getattr(value, "name", value))
    return found


def unusual(mapping: Mapping) -> str:
    """The options of a mapping that are not the default's, such as ``"sweeps=0"``."""
    found, usual = choices(mapping), choices(replace(DM_GC, name=mapping.name))
    return ", ".join(f"{name}={found[name]}" for name in OPTIONS if found[name] != usual[name])


def warn_of_courant(comm, number: float, stepping: Newmark | QuasiStatic) -> None:
    """Warn of a step over which waves run through so many cells that units are likely amiss."""
    if stepping.dynamic and number > UNLIKELY:
        warn(
            comm,
            f"with {stepping} P waves run through {number:.3g} cells a step, and what they do is "
            "not resolved: Courant numbers are about 1; look at the units of dt (s), of the moduli "
            "(Pa) and of the density (kg/m³)",
            3,
        )


PAPER = {
    "mapping": replace(
        DM_GC,
        mass=DOUBLE_MAPPED,
        sweeps=0,
        correction=AccelerationCorrection.OFF,
        b_bar=False,
        hold_cut_cells=False,
    ),
    "initial_acceleration": InitialAcceleration.ZERO,
}
"""Keywords of ``Simulation`` for the step of Do et al. (2023), the start included: ``mapping``, of
which there can be no other, and ``initial_acceleration``.

What stays as it is here: composite strain linear across, patches of one material, the known motion
of fixed nodes, loads on surfaces instead of the outermost points (docs/theory/departures.md)."""


OPTIONS = ("mass", "stress", "sweeps", "transfer", "b_bar", "hold_cut_cells")
OF_MAPPING = ("sweeps", "transfer", "correction", "b_bar", "hold_cut_cells")
OF_SOLVER = ("newton", "reuse")


def of_today(run: str, mapping: Mapping, solver, old: dict[str, object]) -> tuple[Mapping, Solver]:
    """Mapping and solver with what ``old`` arguments of a ``run`` say, each with a
    ``DeprecationWarning``.

    Raises ``ValueError`` for values that are no options, ``TypeError`` for arguments that are none.
    """
    an_object("mapping", mapping, Mapping, "an object such as DM_GC, imported by its name")
    rest = dict(old)
    balanced = rest.pop("balanced", None)
    if balanced is not None:
        kind = AccelerationCorrection.LUMPED if balanced else AccelerationCorrection.OFF
        _warn("balanced", f"mapping=replace(mapping, correction={kind})")
        if balanced not in (True, False):
            raise ValueError(f"balanced must be True or False, got {balanced!r}")
        mapping = replace(mapping, correction=kind)
    for name in OF_MAPPING:
        if name in rest:
            _warn(name, f"mapping=replace(mapping, {name}=...)")
            mapping = replace(mapping, **{name: rest.pop(name)})
    return mapping, solver_of_today(run, solver, rest, deep=1)


def solver_of_today(run: str, solver, old: dict[str, object], deep: int = 0) -> Solver:
    """The same of the solver alone."""
    rest = dict(old)
    if solver is None:
        solver = Solver()
    elif not isinstance(solver, Solver):
        if not isinstance(solver, Options):
            raise ValueError(
                f"solver must be a Solver, such as Solver(petsc={{...}}), got {in_short(solver)}"
            )
        _warn("solver={...}", "solver=Solver(petsc={...})", deep)
        solver = Solver(petsc=solver)
    for name in OF_SOLVER:
        if name in rest:
            _warn(name, f"solver=Solver({name}=...)", deep)
            value = rest.pop(name)
            solver = replace(solver, **{name: Newton() if value is None else value})
    if rest:
        raise TypeError(f"{run} takes no argument {', '.join(rest)}; see help({run})")
    return solver


def _warn(before: str, now: str, deep: int = 0) -> None:
    warnings.warn(f"{before} of a run is now {now}", DeprecationWarning, stacklevel=4 + deep)


def courant_number(
    grid: Grid, bodies: Sequence[MaterialPoints], stepping: Newmark | QuasiStatic
) -> float:
    """c_p Δt / h of the fastest P wave and the smallest cell; zero where there is no inertia.
    Collective."""
    if not stepping.dynamic:
        return 0.0
    return max(body.material.p_speed for body in bodies) * stepping.dt / grid.smallest


def crossings(grid: Grid, materials: Sequence) -> float:
    """Of how many of the smallest cells, of any mesh, P waves of the fastest material run through
    in a second (1/s).  Collective."""
    return max(law.p_speed for law in materials) / grid.smallest


def nodes_of(grid: Grid, cells: Sequence[np.ndarray]) -> int:
    """How many nodes of the grid belong to the cells (n,) of bodies; those that only another rank
    knows of are left out.  Collective."""
    held = np.zeros(grid.nodes, dtype=bool)
    for cell in cells:
        held[dolfinx_versions.cell_dofs(grid.space)[cell]] = True
    return grid.comm.allreduce(int(held[: grid.space.dofmap.index_map.size_local].sum()))


def chosen_b_bar(asked: bool | None, materials: Sequence, able: bool = True) -> bool:
    """What is asked for; where that is None, whether a law needs it and the method is ``able``."""
    return able and any(law.keeps_volume for law in materials) if asked is None else asked


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
