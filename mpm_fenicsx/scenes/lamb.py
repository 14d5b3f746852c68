"""Lamb's problem: a blow on the surface of ground without end, of which a box is modelled.

A strip in plane strain, or a square in three dimensions, is struck by Ricker's wavelet.  Body waves
and a surface wave run off to the edges of the box: viscous or viscoelastic ones, or an absorbing
layer, which send a part of them back.  ``"large"`` is the same ground on a mesh so wide that
nothing comes back before the end: what the others are measured by, with the same cells and steps.
How the surface moves in plane strain is exact in ``analytical.half_space``.  The load is so small
that points stay in their cells.  Units: m, s, kg, Pa.

    large, layer = (Lamb(edge).finite_elements() for edge in ("large", "layer"))
    known, found = (run.record(Watch(Lamb())) for run in (large, layer))
    large.until(Lamb().end)
    layer.until(Lamb().end)
    found.error(known)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import mpm_fenicsx as mpm

from ..analytical.half_space import settlement_beside_a_strip

BOUNDARIES = ("viscous", "viscoelastic", "layer", "large")

soil = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)


def ricker(t: np.ndarray | float, period: float) -> np.ndarray:
    """Ricker's wavelet (-), 1 at most, at times t (s); its spectrum is largest at 1/``period`` and
    its mean is zero.  Before t = 0 it is below 1e-8."""
    a = (np.pi * (np.asarray(t, float) / period - 1.5)) ** 2
    return (1.0 - 2.0 * a) * np.exp(-a)


def held(t: np.ndarray | float, period: float) -> np.ndarray:
    """A load (-) that grows over a ``period`` (s), smoothly, and stays."""
    share = np.clip(np.asarray(t, float) / period, 0.0, 1.0)
    return share**2 * (3.0 - 2.0 * share)


@dataclass(frozen=True)
class Lamb:
    """The blow, the box and what lies around it.

    ``boundary``: one of ``BOUNDARIES``; ``dim``: 2, the whole box under a line load, or 3, a
    quarter of it under a point load between two planes of symmetry.  ``cells``: half the width of
    the box and its depth, in cells of ``cell`` (m); ``wave``: length of the S wave at the peak of
    the wavelet's spectrum, in cells.  ``load`` (Pa) at most, on two cells across, times ``history``
    (t, period).  ``around``: so many more cells at the sides and below, beyond the box; by default
    those of the layer, or as many as keep echoes away until the end.  ``symmetric``: half of the
    box in 2D.
    """

    boundary: str = "layer"
    dim: int = 2
    cells: int = 12
    wave: float = 10.0
    cell: float = 0.5
    load: float = 1e3
    history: Callable = ricker
    periods: float = 5.0
    around: int | None = None
    symmetric: bool = False

    def __post_init__(self) -> None:
        if self.boundary not in BOUNDARIES:
            raise ValueError(f"boundary must be one of {BOUNDARIES}, got {self.boundary!r}")
        if self.dim not in (2, 3):
            raise ValueError(f"dim must be 2 or 3, got {self.dim!r}")
        if self.dim == 3:
            object.__setattr__(self, "symmetric", True)
        if self.around is None:
            object.__setattr__(self, "around", self._around)

    @property
    def _around(self) -> int:
        if self.boundary == "layer":
            return mpm.AbsorbingLayer("bottom", soil).thickness
        if self.boundary != "large":
            return 0
        way = soil.p_speed * self.end / self.cell  # there and back, from the load to the box
        return int(np.ceil(0.5 * (way - self.cells))) + 2

    @property
    def period(self) -> float:
        """Of the peak of the wavelet's spectrum (s)."""
        return self.wave * self.cell / soil.s_speed

    @property
    def step(self) -> float:
        """Half the time (s) in which P waves cross a cell."""
        return 0.5 * self.cell / soil.p_speed

    @property
    def end(self) -> float:
        """A whole number of steps, about ``periods`` (s)."""
        return round(self.periods * self.period / self.step) * self.step

    def inside(self, x: np.ndarray) -> np.ndarray:
        """Whether places x (dim, n), m, lie in the box, its edges included."""
        half = self.cells * self.cell + 1e-9
        return (np.abs(np.delete(x, 1, axis=0)) < half).all(axis=0) & (x[1] > -half)

    # -- scenes ------------------------------------------------------------------------------------

    def grid(self) -> mpm.Grid:
        """The surface at y = 0; facets "struck" are those under the load."""
        beyond = self.cell * (self.cells + self.around)
        n = self.cells + self.around
        across = (0.0, n) if self.symmetric else (-beyond, 2 * n)
        low = [across[0], -beyond, 0.0][: self.dim]
        high = [beyond, 0.0, beyond][: self.dim]
        under = self.cell + 1e-9

        def struck(x):
            return (np.abs(np.delete(x, 1, axis=0)) < under).all(axis=0) & (x[1] > -1e-9)

        counts = (across[1], n, n)[: self.dim]
        return mpm.Grid.box(tuple(low), tuple(high), counts, facets={"struck": struck})

    def terms(self, grid: mpm.Grid) -> list:
        """The load, planes of symmetry, and what holds the box."""
        blow = mpm.Traction(
            grid.facets("struck"),
            lambda t: (0.0, -self.load * float(self.history(t, self.period)), 0.0)[: self.dim],
        )
        planes = [("left", "x"), ("back", "z")][: self.dim - 1] if self.symmetric else []
        sides = ["right", "bottom", *([] if self.symmetric else ["left"])]
        sides += ["front"] if self.dim == 3 else []
        edges = grid.facets(*sides)
        end = {
            "viscous": lambda: mpm.ViscousBoundary(edges, soil),
            "viscoelastic": lambda: mpm.ViscoelasticBoundary(edges, soil, self.cells * self.cell),
            "layer": lambda: mpm.AbsorbingLayer(sides, soil),
            "large": lambda: mpm.Fixed(edges),
        }[self.boundary]()
        return [blow, *(mpm.Fixed(grid.facets(side), across) for side, across in planes), end]

    def finite_elements(self, **options) -> mpm.FiniteElements:
        """Finite elements all over; ``options`` of ``FiniteElements``."""
        grid = self.grid()
        stepping = mpm.Newmark(self.step)
        return mpm.FiniteElements(grid, soil, stepping, self.terms(grid), **options)

    def material_points(
        self, mapping: mpm.Mapping = mpm.DM_GC, per_cell: int | None = None, **options
    ) -> mpm.Simulation:
        """Material points, but in the layer; ``options`` of ``Simulation``."""
        grid = self.grid()
        everywhere = self.boundary != "layer"
        body = mpm.MaterialPoints.fill(
            grid, soil, per_cell or 2**self.dim, lambda x: everywhere | self.inside(x)
        )
        stepping = mpm.Newmark(self.step)
        return mpm.Simulation(grid, body, stepping, self.terms(grid), mapping, **options)

    def answer(self, x: float, times: np.ndarray) -> np.ndarray:
        """Exact settlement (n,), m, of the surface at ``x`` (m) at even times (n,), s, from 0 on,
        of a scene in 2D."""
        pressure = self.load * self.history(times, self.period)
        speeds = soil.p_speed, soil.s_speed
        return settlement_beside_a_strip(x, self.cell, times, pressure, *speeds, soil.density)


POINT_LOAD = {"dim": 3, "cells": 6, "wave": 8.0, "periods": 3.5}
"""Of a scene in 3D that runs in a minute: ``Lamb("layer", **POINT_LOAD)``."""


class Watch:
    """Recorder of the displacements of the box's nodes, for one rank.

    ``times`` (n,), s, and ``values`` (n, nodes, dim), m: at the start and after each step, nodes in
    the order of their ``places`` (nodes, dim), which is the same whatever lies around.  Raises
    ``ValueError`` for several ranks.
    """

    def __init__(self, scene: Lamb):
        self._scene = scene
        self._times: list[float] = []
        self._values: list[np.ndarray] = []

    @property
    def times(self) -> np.ndarray:
        """When it looked (n,), s."""
        return np.array(self._times)

    @property
    def values(self) -> np.ndarray:
        """What it saw (n, nodes, dim), m."""
        return np.array(self._values)

    def attach(self, run) -> None:
        """Find the nodes."""
        grid, scene = run.grid, self._scene
        if grid.comm.size > 1:
            raise ValueError(
                f"Watch is for one rank, the run has {grid.comm.size}: start it on one"
            )
        x = grid.space.tabulate_dof_coordinates()[:, : grid.dim]
        at = np.flatnonzero(scene.inside(x.T))
        self._nodes = at[np.lexsort(np.round(x[at] / scene.cell).T)]
        self.places = x[self._nodes]

    def __call__(self, run) -> None:
        """Add the step's increment."""
        moved = run.nodal("increment")[self._nodes]
        self._times.append(run.time)
        self._values.append(self._values[-1] + moved if self._values else np.zeros_like(moved))

    def at(self, place) -> np.ndarray:
        """Vertical displacement (n,), m, positive downwards, at the node nearest to a place (dim,),
        m."""
        node = np.linalg.norm(self.places - np.asarray(place), axis=1).argmin()
        return -self.values[:, node, 1]

    def error(self, known: Watch) -> float:
        """Distance of the displacements of all nodes at all times from known ones, in L2, over the
        size of these."""
        return float(np.linalg.norm(self.values - known.values) / np.linalg.norm(known.values))

    def errors(self, known: Watch) -> np.ndarray:
        """The same at each time (n,), over the largest size of the known ones at any time."""
        apart, size = (
            np.sqrt((values**2).sum(axis=(1, 2)))
            for values in (self.values - known.values, known.values)
        )
        return apart / size.max()
