"""A strip presses on soil that softens, between fixed, viscous or viscoelastic boundaries, or in an
absorbing layer.

The foundation of Do, Vardon, González Acosta & Hicks (2023), section 4.2.  Units: m, s, kg, Pa.
The paper prints neither load nor softening modulus nor the points' places: they are assumed here,
as are rollers where the sides are fixed.  Its quasi-static first step is left out: without gravity
there is nothing at rest to carry over.

No exact answer of the whole is known.  Known are the yield plateau (``plateau``), the time at which
a boundary is felt first (the P wave's way there and back) and, of a strip that is pressed slowly,
the capacity (2 + π) c (``scenes.strip``).

    scene = Foundation("viscous", cell=0.125)
    run = scene.material_points()
    run.until(end)

Beside what the paper has, the soil away from the strip can be a far field of finite elements, and a
layer can absorb what reaches its edges::

    Foundation("viscous", box=(2.0, 2.0))  # points in 2 m x 2 m under the strip
    Foundation("layer", box=(2.0, 2.0))
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import mpm_fenicsx as mpm

BOUNDARIES = ("fixed", "viscous", "viscoelastic")
"""The paper's."""
LAYER = "layer"
"""Cells that absorb, around the body, beside these."""

# The paper's.
width, height, strip = 6.0, 4.0, 1.0
elastic = mpm.LinearElastic(young=2e6, poisson=0.41, density=1000.0)
peak, residual = 10e3, 3e3  # cohesion
plateau = 3**0.5 * peak  # of the deviatoric stress, in all that follows q = √(3/2 s:s)
end, dt = 0.925, 5e-3

# Assumed: the paper prints none of these.
ASSUMED = "assumed: load, softening, places of the points, radius; no quasi-static first step"
softening = 50e3  # of cohesion, a unit of plastic strain
load = 26e3
first, on, off = 0.225, 0.2, 0.1  # half-sines: start of the first, duration, pause
radius = 4.0  # from the strip to the base, for the springs
axis = width / 2
point_1, point_2 = (axis, height - 0.5), (axis, height - 0.97)


def pulses(t, load):
    """Half-sines with pauses."""
    since = np.asarray(t) - first
    phase = since % (on + off)
    return np.where((since > 0) & (phase < on), load * np.sin(np.pi * phase / on), 0.0)


def soil(softening=softening) -> mpm.VonMises:
    """Von Mises soil of a softening (Pa)."""
    return mpm.VonMises(elastic, peak, residual, softening)


def under_strip(x):
    """Whether x lies within the strip's width."""
    return np.abs(x[0] - axis) < strip / 2 + 1e-9


def in_body(x):
    """Whether x lies in the body."""
    return (x[0] > 0) & (x[0] < width) & (x[1] > 0) & (x[1] < height)


def _strip(x):
    return under_strip(x) & (np.abs(x[1] - height) < 1e-9)


def _edge(x):
    """Sides and base, without what lies above the body."""
    at_side = (np.abs(x[0] - axis) > axis - 1e-9) & (x[1] < height + 1e-9)
    return at_side | (np.abs(x[1]) < 1e-9)


def _growing(size: float, growth: float, largest: float, reach: float) -> np.ndarray:
    """Distances (n,), m, of grid lines from an edge, whose cells grow until they ``reach``."""
    lines = [0.0]
    while lines[-1] < reach:
        size = min(growth * size, largest)
        lines.append(lines[-1] + size)
    return np.array(lines[1:])


@dataclass(frozen=True)
class Foundation:
    """The foundation between one kind of boundary, under a load.

    ``boundary``: one of ``BOUNDARIES``, or ``LAYER``; ``load`` (Pa) and ``history`` (t, load), the
    pressure (Pa) on the strip; ``softening`` (Pa), or the soil's whole ``law``; ``cell`` (m),
    ``step`` (s); ``loading``: ``Traction``, or ``DeadLoad`` that keeps its force; ``more`` terms.
    ``box``: width and depth (m), whole cells, of the soil under the strip; outside of it is a far
    field of elastic finite elements, which follows what settles.  All is soil, if None.
    ``b_bar``: whether volume changes by the means of cells, as it does by default for soil that
    yields (None); the paper's does without.
    Raises ``ValueError`` for a boundary of another name, and for a box that does not end on grid
    lines inside the body.
    """

    boundary: str
    load: float = load
    softening: float = softening
    cell: float = 0.0625
    step: float = dt
    history: Callable = pulses
    loading: type = mpm.Traction
    law: mpm.Law | None = None
    more: tuple = ()
    box: tuple[float, float] | None = None
    b_bar: bool | None = False

    def __post_init__(self) -> None:
        if self.boundary not in (*BOUNDARIES, LAYER):
            raise ValueError(
                f"boundary must be one of {', '.join((*BOUNDARIES, LAYER))}, got {self.boundary!r}"
            )
        if self.box is not None:
            wide, deep = self.box
            lines = np.array([(width - wide) / 2, height - deep]) / self.cell
            off = np.abs(lines - np.round(lines)).max()
            if not (strip < wide < width and 0 < deep < height) or off > 1e-6:
                raise ValueError(
                    f"box must be wider than the strip, {strip} m, lie inside the body and end on "
                    f"grid lines, which are {self.cell} m apart, got {self.box}"
                )

    @property
    def soil(self) -> mpm.Law:
        """The law of the body."""
        return self.law or soil(self.softening)

    def in_box(self, x) -> np.ndarray:
        """Whether x (dim, n) lies in the body, where that is soil rather than a far field."""
        wide, deep = self.box or (width, height)
        return (np.abs(x[0] - axis) < wide / 2) & (x[1] > height - deep) & (x[1] < height)

    def terms(self, surface, grid) -> list:
        """The scene; ``surface`` gives facets to finite elements and surface points to material
        points."""
        pressed = self._pressed(surface("top", where=under_strip))
        return [*self._far_field(), pressed, *self._edges(surface, grid), *self.more]

    def _pressed(self, on):
        """The load on the strip."""
        return self.loading(on, lambda t: (0.0, -float(self.history(t, self.load))))

    def _edges(self, surface, grid) -> list:
        """What holds the body at its sides and its base."""
        if self.boundary == LAYER:
            return [self.layer]
        if self.boundary == "fixed":
            return [mpm.Fixed(grid.facets("left", "right"), "x"), mpm.Fixed(grid.facets("bottom"))]
        far = self.box is not None
        edge = grid.facets("edge") if far else surface("left", "right", "bottom")
        if self.boundary == "viscous":
            return [mpm.ViscousBoundary(edge, elastic)]
        return [mpm.ViscoelasticBoundary(edge, elastic, radius)]

    @property
    def layer(self) -> mpm.AbsorbingLayer:
        """The layer around the body."""
        return mpm.AbsorbingLayer(("left", "right", "bottom"), elastic)

    def _far_field(self) -> list:
        if self.box is None:
            return []
        return [mpm.FarField(lambda x: in_body(x) & ~self.in_box(x), elastic, follows=True)]

    def finite_elements(self, **options) -> mpm.FiniteElements:
        """The twin, small strain: facets of the mesh bear the load and the dashpots; ``options`` of
        ``FiniteElements``."""
        grid = self._around(self._beyond, 0, strip=_strip)

        def surface(*sides, where=None):
            return grid.facets("strip") if where else grid.facets(*sides)

        options = {"b_bar": self.b_bar, **options}
        return mpm.FiniteElements(
            grid, self.soil, mpm.Newmark(self.step), self.terms(surface, grid), **options
        )

    def wide_ground(self, growth: float = 1.1, largest: float = 0.5) -> mpm.FiniteElements:
        """Finite elements in ground so wide that nothing comes back until ``end``, whatever the
        ``boundary``: cells of the body's size there, outside of it each ``growth`` times the one
        before, up to the ``largest`` (m)."""
        reach = elastic.p_speed * (end - first) / 2  # m, there and back
        beyond = _growing(self.cell, growth, largest, reach)
        across = np.linspace(0.0, width, round(width / self.cell) + 1)
        down = np.linspace(0.0, height, round(height / self.cell) + 1)
        grid = mpm.Grid.rectilinear(
            [
                np.concatenate((-beyond[::-1], across, width + beyond)),
                np.concatenate((-beyond[::-1], down)),
            ],
            facets={"strip": _strip},
        )
        pressed = self._pressed(grid.facets("strip"))
        edges = mpm.Fixed(grid.facets("left", "right", "bottom"))
        return mpm.FiniteElements(grid, self.soil, mpm.Newmark(self.step), [pressed, edges])

    def grid(self, room: float = 0.25) -> mpm.Grid:
        """Of material points: with ``room`` (m, whole cells at least) for heave, and around sides
        and base where they drift."""
        rows = int(np.ceil(room / self.cell - 1e-9))
        drifts = self.box is None and self.boundary in ("viscous", "viscoelastic")
        return self._around(rows if drifts else self._beyond, rows)

    @property
    def _beyond(self) -> int:
        """Rows of cells around sides and base that are no part of the body and hold no points."""
        return self.layer.thickness if self.boundary == LAYER else 0

    def _around(self, beyond: int, above: int, **facets: Callable) -> mpm.Grid:
        """The body's grid, with so many rows of cells beyond its sides and base, and above it."""
        edge, room = beyond * self.cell, above * self.cell
        return mpm.Grid.box(
            (-edge, -edge),
            (width + edge, height + room),
            (
                round(width / self.cell) + 2 * beyond,
                round(height / self.cell) + beyond + above,
            ),
            facets={"edge": _edge, **facets} if self.box else facets,
        )

    def material_points(
        self,
        mapping: mpm.Mapping = mpm.DM_GC,
        grid: mpm.Grid | None = None,
        *,
        kind: type = mpm.Simulation,
        **options,
    ) -> mpm.Simulation:
        """Material points, four a cell, on ``grid`` or one that is made for them; ``options`` of
        ``Simulation``, or of the ``kind`` of it."""
        grid = self.grid() if grid is None else grid
        points = mpm.MaterialPoints.fill(
            grid,
            self.soil,
            per_cell=4,
            inside=self.in_box,
        )
        scene = self.terms(points.surface, grid)
        if mapping.b_bar is None and mapping.integrate is mpm.DOUBLE_MAPPED:
            mapping = replace(mapping, b_bar=self.b_bar)
        return kind(grid, points, mpm.Newmark(self.step), scene, mapping, **options)
