"""A box of ground that is struck on its surface, with several boundaries: error and cost of a step.

Cells are 1 m, c_s = ρ = 1, ν = 0.25.  The box is 24 × 12 cells; a strip of two cells in the middle
of its surface bears Ricker's wavelet, of which S waves at its peak have 8 cells.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

import mpm_fenicsx as mpm

soil = mpm.LinearElastic(young=2.5, poisson=0.25, density=1.0)
WIDE, DEEP, WAVELENGTH = 24, 12, 8  # cells
DT = 0.5 / soil.p_speed  # s
SIDES = ("left", "right", "bottom")
BLOCK = 8  # steps of a run before it is another's turn


def ricker(t: float) -> tuple[float, float]:
    """Traction, Pa."""
    a = (np.pi * (soil.s_speed / WAVELENGTH * t - 1.5)) ** 2
    return 0.0, -1e-4 * (1 - 2 * a) * np.exp(-a)


@dataclass(frozen=True)
class Boundary:
    """What is done at the box's sides: ``kind`` dashpots, springs or layer; ``beyond`` cells of
    ground before it comes, or absorbing cells of the layer."""

    kind: str
    beyond: int = 0

    def __str__(self) -> str:
        if self.kind == "layer":
            return f"layer, {self.beyond} cells"
        return f"{self.kind}, {self.beyond} cells further" if self.beyond else self.kind

    @property
    def room(self) -> int:
        """Cells of the grid beyond the box."""
        return self.beyond + 4 * (self.kind == "layer")

    def term(self, grid: mpm.Grid):
        """The term that stands for the ground beyond."""
        if self.kind == "layer":
            return mpm.AbsorbingLayer(SIDES, soil, self.beyond)
        on = grid.facets(*SIDES)
        if self.kind == "fixed":
            return mpm.Fixed(on)
        if self.kind == "springs":
            return mpm.ViscoelasticBoundary(on, soil, radius=float(DEEP))
        return mpm.ViscousBoundary(on, soil)


DASHPOTS, SPRINGS, LAYERS = (
    Boundary("dashpots"),
    Boundary("springs"),
    [Boundary("layer", n) for n in (2, 3, 5)],
)
FURTHER = [Boundary("dashpots", n) for n in (8, 16, 32, 64)]


def large(until: float) -> Boundary:
    """So far away that nothing comes back into the box by then (s)."""
    return Boundary("fixed", int(np.ceil(0.5 * (soil.p_speed * until - DEEP))) + 2)


class Struck:
    """A run, its displacement at the nodes of the box after each step, and CPU seconds of blocks of
    steps."""

    def __init__(self, boundary: Boundary, points: bool, reassemble: bool = True):
        room = boundary.room
        half, deep = WIDE // 2 + room, DEEP + room
        grid = mpm.Grid.box(
            (-half, -deep),
            (half, 0),
            (2 * half, deep),
            facets={"strip": lambda x: (x[1] > -1e-9) & (abs(x[0]) < 1 + 1e-9)},
        )
        terms = [mpm.Traction(grid.facets("strip"), ricker), boundary.term(grid)]
        if points:
            ground = boundary.beyond if boundary.kind != "layer" else 0
            body = mpm.MaterialPoints.fill(
                grid,
                soil,
                4,
                lambda x: (abs(x[0]) < WIDE / 2 + ground) & (x[1] > -DEEP - ground),
            )
            self.run = mpm.Simulation(grid, body, mpm.Newmark(DT), terms)
        else:
            self.run = mpm.FiniteElements(grid, soil, mpm.Newmark(DT), terms, reassemble=reassemble)
        x = grid.space.tabulate_dof_coordinates()[:, :2]
        box = np.flatnonzero((abs(x[:, 0]) < WIDE / 2 + 0.5) & (x[:, 1] > -DEEP - 0.5))
        self.nodes = box[np.lexsort(np.rint(x[box]).T)]
        self.moved, self.seconds = [np.zeros((len(box), 2))], []
        self.cells = grid.cells

    def go(self, steps: int) -> None:
        """Some steps, timed."""
        seconds = 0.0
        for _ in range(steps):
            began = time.process_time()
            self.run.step()
            seconds += time.process_time() - began
            self.moved.append(self.moved[-1] + self.run.nodal("increment")[self.nodes])
        self.seconds.append(seconds / steps)


def lamb(
    boundaries: list[Boundary], points: bool, until: float = 120.0, early: float = 40.0
) -> list[dict]:
    """Errors of displacement, relative, in L2 over the nodes of the box and time until ``early``
    and ``until`` (h/c_s), against a mesh from which nothing comes back; ms a step over that with
    dashpots, median and quartiles of blocks in turns."""
    reference = Struck(large(until), points, reassemble=False)
    blocks = round(until / DT / BLOCK)
    for _ in range(blocks):
        reference.go(BLOCK)
    exact = np.array(reference.moved)
    runs = {boundary: Struck(boundary, points) for boundary in boundaries}
    for _ in range(blocks):
        for struck in runs.values():
            struck.go(BLOCK)
    rows = []
    for boundary, struck in runs.items():
        # the first block compiles
        ratios = np.array(struck.seconds[1:]) / runs[DASHPOTS].seconds[1:]
        row = {
            "method": "DM-GC" if points else "FE",
            "boundary": str(boundary),
            "cells": struck.cells,
        }
        for name, end in (("error", until), ("error_early", early)):
            at = slice(round(end / DT) + 1)
            off = np.linalg.norm(np.array(struck.moved)[at] - exact[at])
            row[name] = float(off / np.linalg.norm(exact[at]))
        row["ms_a_step"] = 1e3 * float(np.median(struck.seconds[1:]))
        row["cost"] = np.percentile(ratios, (50, 25, 75)).tolist()
        rows.append(row)
    return rows
