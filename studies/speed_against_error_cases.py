"""The settings that ``speed_against_error`` runs, and one measured run."""

from __future__ import annotations

import ctypes
import gc
import re
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from speed_against_error_scenes import SCENES

from mpm_fenicsx import RunError, Solver

METHODS = ("FE", "MPM", "GIMP", "DM-G", "DM-GC", "DM-GCL")
MORE = ("FE reassembled", "CMPM", "DM", "DM-C")
ERRORS = ("error_displacement", "error_velocity", "error_stress")
COURANT, MOST = (4.0, 2.0, 1.0, 0.5), 2000  # Courant numbers from fast to slow runs; steps at most
WILD = 10.0  # stress over the largest exact one: beyond, a run is unstable


@dataclass(frozen=True)
class Case:
    """One run: ``cell`` (m), ``dt`` (s), points per cell, relative tolerance of the linear solver
    (None: as it is)."""

    scene: str
    method: str
    cell: float
    dt: float
    per_cell: int | None = 4
    tolerance: float | None = None

    @classmethod
    def of(cls, row: dict) -> Case:
        """The case of a row."""
        return cls(**{name: row[name] for name in cls.__dataclass_fields__})


def grid(scene: str) -> list[tuple[float, float]]:
    """All cells with all time steps, but for those that make too many of them."""
    s = SCENES[scene]
    every = [(h, s.step(h, courant)) for courant in COURANT for h in s.cells]
    return [(h, dt) for h, dt in every if s.end / dt <= MOST]


def together(scene: str) -> list[tuple[float, float]]:
    """Cells and time steps that are refined together, at Courant number 1."""
    s = SCENES[scene]
    return [(h, s.step(h, 1.0)) for h in s.cells]


def in_space(scene: str) -> list[tuple[float, float]]:
    """Cells refined at one time step: the smallest that the finest of them is run with."""
    s = SCENES[scene]
    dt = min(dt for h, dt in grid(scene) if h == s.cells[-1])
    return [(h, dt) for h in s.cells]


def in_time(scene: str) -> list[tuple[float, float]]:
    """Time steps refined in the finest cells."""
    s = SCENES[scene]
    return [
        (s.cells[-1], s.step(s.cells[-1], courant))
        for courant in (16, 8, *COURANT)
        if s.end / s.step(s.cells[-1], courant) <= MOST
    ]


def settings(scene: str, quick: bool) -> Iterator[dict]:
    """Settings of a scene; ``quick`` ones are those of coarse cells."""
    s = SCENES[scene]
    bar = scene.startswith("bar")
    for h, dt in together(scene)[: 3 if bar else 1] if quick else grid(scene):
        yield {"cell": h, "dt": dt}
    if not s.thorough or (quick and not bar):
        return
    h, dt = together(scene)[-2]
    for tolerance in (1e-2, 1e-4, 1e-6, 1e-8):
        yield {"cell": h, "dt": dt, "tolerance": tolerance}
    for per_cell in (1, 9, 16):
        yield {"cell": h, "dt": dt, "per_cell": per_cell}
    if not quick:
        for h, dt in in_space(scene) + in_time(scene):
            yield {"cell": h, "dt": dt}


def cases(scenes, methods, quick: bool) -> list[Case]:
    """All runs, methods one after the other, so that what a machine does at times meets them
    alike."""
    found = {}
    for scene in scenes:
        for setting in settings(scene, quick):
            for method in methods:
                if method == "FE" and "tolerance" in setting:  # it has a full factor
                    continue
                if method.startswith("FE") and "per_cell" in setting:
                    continue
                case = Case(scene, method, **setting)
                found[replace(case, per_cell=None) if method.startswith("FE") else case] = None
    return list(found)


def measure(case: Case) -> dict:
    """One run: seconds in its steps alone, errors, memory; what goes wrong in a step is part of the
    row."""
    gc.collect()
    with suppress(AttributeError):  # not glibc
        ctypes.CDLL(None).malloc_trim(0)  # what earlier runs left is not this one's
    before, began = _memory("VmRSS", reset=True), time.perf_counter()
    scene = SCENES[case.scene]
    options = {"reassemble": True} if case.method == "FE reassembled" else {}
    if case.tolerance is not None:
        options["solver"] = Solver(petsc={"ksp_rtol": case.tolerance})
    run = scene.make(case.method, case.cell, case.dt, case.per_cell, **options)
    watch = scene.watch(run)
    row = {
        **vars(case),
        "set_up_seconds": time.perf_counter() - began,
        "cells": run.grid.cells,
        "points": sum(len(body) for body in run.bodies),
        "unstable_at_step": None,
        "reason": None,
    }
    steps, seconds, cpu = round(scene.end / case.dt), 0.0, 0.0
    while run.steps < steps and row["unstable_at_step"] is None:
        clock, own = time.perf_counter(), time.process_time()
        try:
            run.step()
        except RunError as error:
            row.update(unstable_at_step=run.steps + 1, reason=str(error))
        seconds, cpu = seconds + time.perf_counter() - clock, cpu + time.process_time() - own
        if row["unstable_at_step"] is None and not watch() < WILD:
            row.update(
                unstable_at_step=run.steps,
                reason=f"stress beyond {WILD:g} times the largest exact one",
            )
    stable = row["unstable_at_step"] is None
    row.update(watch.errors() if stable else dict.fromkeys(ERRORS))
    most = _memory("VmHWM")
    return {
        **row,
        "steps": run.steps,
        "iterations": run.equilibrium.iterations,
        "solves": run.solves,
        "seconds": seconds,
        "cpu_seconds": cpu,
        "ms_per_step": 1e3 * seconds / max(run.steps, 1),
        "memory_mb": most,
        "memory_growth_mb": None if most is None or before is None else most - before,
    }


def _memory(name: str, reset: bool = False) -> float | None:
    """Resident memory of this process (MB): now, VmRSS, or the most since ``reset``, VmHWM; None
    but on Linux."""
    try:
        if reset:
            Path("/proc/self/clear_refs").write_text("5")
        return int(re.search(rf"{name}:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 1024
    except OSError:
        return None
