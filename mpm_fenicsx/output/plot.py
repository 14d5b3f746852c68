"""A quick look: one field of the points, or of a finite element run, as a picture."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import NamedTuple

from mpi4py import MPI

import numpy as np

from ..common import tensors
from ..common.checks import finite, in_short, one_of
from ..common.files import failing_together, named
from ..common.ranks import together
from ..grid.stress_field import StressField
from .fields import grid_frame, grid_piece, points_piece, stress_piece, whole
from .recorders import ON_THE_GRID

QUANTITIES = {
    "stress": ("stress", "Pa"),
    ON_THE_GRID: ("stress on the grid", "Pa"),
    "mean_stress": ("mean stress", "Pa"),
    "von_mises": ("von Mises stress", "Pa"),
    "velocity": ("velocity", "m/s"),
    "displacement": ("displacement", "m"),
    "volume": ("volume", "m³"),
    "density": ("density", "kg/m³"),
    "half": ("half the support domain", "m"),
    "seat": ("centre of the support domain", "m"),
}
"""What fields are called beside the colours, and their units; others go by their own names."""

_TENSION_POSITIVE = {"stress", ON_THE_GRID, "mean_stress"}
_ROWS = {2: ("xx", "yy", "zz", "xy"), 3: ("xx", "yy", "zz", "xy", "yz", "xz")}
_IN_PLANE = {"x": "zy", "y": "xz", "z": "xy"}
"""Axes of the picture across and upwards, by the normal of the plane; y is upwards where it can."""


class View(NamedTuple):
    """What there is to see: ``corners`` (n, 4, 2) of the shapes in 2D, or their ``lower`` and
    ``upper`` ends (n, 2, 3) in 3D, m; fields (n, …) by name, and names of fields that are to be
    seen elsewhere."""

    dim: int
    shapes: np.ndarray
    fields: dict[str, np.ndarray]
    elsewhere: tuple[str, ...] = ()


def plot(
    what,
    field: str,
    component: str | int | None = None,
    *,
    plane: tuple[str, float] | None = None,
    ax=None,
    save: str | os.PathLike | None = None,
):
    """Draw a field in colours, and return matplotlib's ``Axes``.

    ``what``: material points, a list of such bodies, a run, or its ``stress_field()``.  Points are
    drawn as their support domains.  Of a finite element run the cells of the mesh are drawn, not
    displaced, with nodal fields as the means of their corners.  Of the stress on the grid the cells
    that hold material are drawn, with "stress", "mean_stress" or "von_mises" at their centres; of a
    run that stress is "grid_stress".  ``field``: a name as in ``Snapshots``; bodies that do not
    carry it are grey.  ``component``: "x", "y", "z" of a vector, of which none is the magnitude;
    "xx", "yy", "zz", "xy", … of a stress (tension positive); else the number of a column.
    In 3D the picture is a cut by a ``plane``, such as ("y", 2.0) for y = 2 m; by default one
    normal to z through the middle of what is drawn, at the centre of the nearest point.
    ``ax``: axes to draw in; ``save``: path of a picture to write, whose folder is made.

    Where values have both signs, the smaller side beyond a hundredth of the other, the colours are
    blue and red about zero, else viridis.  Of a run on several ranks, which all call this, the
    first draws all of it, and the others return None; bodies without a run are drawn as far as this
    rank has them.
    Raises ``ValueError`` naming a field, component or plane that there is not, with what there is;
    ``OSError`` where the picture cannot be written.
    """
    save = None if save is None else named(save)
    comm, bodies, title = _sources(what)
    if isinstance(what, StressField):
        view = _of_stress(what, comm)
    elif hasattr(what, "grid_fields"):
        view = _of_run(what, field, comm)
    else:
        view = _of_points(bodies, comm)
    with together(comm):
        if comm.rank == 0:
            made = _draw(view, field, component, plane, ax, title)
    if save is not None:
        with failing_together(comm, "picture not written", save):
            if comm.rank == 0:
                save.parent.mkdir(parents=True, exist_ok=True)
                made.figure.savefig(save, dpi=150)
    if comm.rank != 0:
        return None
    if save is not None and ax is None:
        import matplotlib.pyplot as plt

        plt.close(made.figure)
    return made


def _sources(what) -> tuple[MPI.Comm, Sequence, str]:
    """The ranks that have a share in it, the bodies of points, if any, and a title."""
    if isinstance(what, StressField):
        return what.grid.comm, (), ""
    if hasattr(what, "grid_fields"):
        dynamic = what.stepping.dynamic
        moment = f"t = {what.time:.4g} s" if dynamic else f"load parameter {what.time:.4g}"
        return what.grid.comm, what.bodies, f"{what.name}, {moment}"
    bodies = list(what) if isinstance(what, list | tuple) else [what]
    if not bodies or not all(hasattr(body, "half") and hasattr(body, "stress") for body in bodies):
        raise ValueError(
            "plot needs material points, a list of them, a run such as Simulation(...), or its "
            f"stress_field(), got {in_short(what)}"
        )
    if len({body.dim for body in bodies}) > 1:
        raise ValueError("bodies must all be in 2D or all in 3D to be in one picture")
    return MPI.COMM_SELF, bodies, ""


def _of_run(run, field: str, comm: MPI.Comm) -> View | None:
    """Its points, or its cells where it has none; or the stress on its grid."""
    if field == ON_THE_GRID:
        view = _of_stress(run.stress_field(), comm)
        return view and view._replace(fields={ON_THE_GRID: view.fields["stress"]})
    view = _of_points(run.bodies, comm) if run.bodies else _of_cells(run, comm)
    return view and view._replace(elsewhere=(ON_THE_GRID,))


def _of_points(bodies: Sequence, comm: MPI.Comm) -> View | None:
    """Support domains, on the first rank."""
    found = whole(points_piece(bodies, comm), comm)
    if found is None:
        return None
    x, fields = found.x, found.point_data
    ends = np.stack((x - fields["half"], x + fields["half"]), axis=1)
    dim = x.shape[1]
    return View(dim, ends if dim == 3 else _rectangles(ends), fields)


def _of_cells(run, comm: MPI.Comm) -> View | None:
    """Cells of the mesh, on the first rank."""
    found = whole(grid_piece(run, grid_frame(run.grid)), comm)
    if found is None:
        return None
    x, cells, nodal, cellwise = found
    fields = {name: value[cells].mean(axis=1) for name, value in nodal.items()} | cellwise
    if "stress" in fields:
        fields |= _measures(fields["stress"])
    return _cellwise(x[cells], fields)


def _of_stress(field: StressField, comm: MPI.Comm) -> View | None:
    """Cells that hold material with the stress at their centres, on the first rank."""
    found = whole(stress_piece(field), comm)
    if found is None:
        return None
    x, cells, known, _ = found
    stress = known["stress"][cells].mean(axis=1)
    return _cellwise(x[cells], {"stress": stress, **_measures(stress)})


def _measures(stress: np.ndarray) -> dict[str, np.ndarray]:
    return {"mean_stress": tensors.mean(stress), "von_mises": tensors.von_mises(stress)}


def _cellwise(corners: np.ndarray, fields: dict[str, np.ndarray]) -> View:
    """What there is to see of cells with corners (n, 2^dim, dim)."""
    dim = corners.shape[2]
    if dim == 3:
        corners = np.stack((corners.min(axis=1), corners.max(axis=1)), axis=1)
    return View(dim, corners, fields)


def _rectangles(ends: np.ndarray) -> np.ndarray:
    """Corners (n, 4, 2) of rectangles whose lower and upper ends are (n, 2, 2)."""
    ring = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    return ends[:, ring, [0, 1]]


def _draw(view: View, field: str, component, plane, ax, title: str):
    """The picture, on the first rank."""
    if not len(view.shapes):
        raise ValueError("plot: the bodies have no material points to draw")
    values, label = _values(view, field, component)
    corners, across = view.shapes, "xy"
    if view.dim == 3:
        normal, at, cut = _cut(view.shapes, plane)
        across = _IN_PLANE[normal]
        corners = _rectangles(view.shapes[cut][:, :, ["xyz".index(axis) for axis in across]])
        values = values[cut]
        title = f"{title}, {normal} = {at:.4g} m".removeprefix(", ")
    elif plane is not None:
        raise ValueError(f"plane is for 3D, and this is in 2D, got {plane!r}")

    import matplotlib.pyplot as plt
    from matplotlib.collections import PolyCollection
    from matplotlib.ticker import MaxNLocator

    if ax is None:
        _, ax = plt.subplots(figsize=_size(corners), layout="constrained")
    shapes = PolyCollection(corners, linewidths=0.0, antialiaseds=False, **_colours(values))
    shapes.set_array(np.array(values, float))
    ax.add_collection(shapes)
    ax.autoscale_view()
    ax.set(aspect="equal", xlabel=f"{across[0]}, m", ylabel=f"{across[1]}, m", title=title)
    ax.set_facecolor("0.9")  # what is white in the middle of the colours shows on it
    bar = ax.figure.colorbar(shapes, ax=ax, label=label)
    if values.dtype.kind in "iu":
        bar.locator = MaxNLocator(integer=True)
        bar.update_ticks()
    return ax


def _size(corners: np.ndarray) -> tuple[float, float]:
    """Inches of a figure in which shapes (n, 4, 2) leave little room unused."""
    width, height = np.ptp(corners.reshape(-1, 2), axis=0)
    return 1.9 + 4.8 * min(1.0, width / height), 1.0 + max(1.4, 4.8 * min(1.0, height / width))


def _values(view: View, field: str, component) -> tuple[np.ndarray, str]:
    """Numbers (n,) to show, and words with the unit for them."""
    rows = view.fields[one_of("field", field, (*view.fields, *view.elsewhere))]
    text, unit = QUANTITIES.get(field, (field.replace("_", " "), ""))
    if rows.ndim == 1:
        if component is not None:
            raise ValueError(f"component: {field} has none, got {component!r}")
        values = rows
    else:
        rows = rows.reshape(len(rows), -1)
        width = rows.shape[1]
        letters = {view.dim: "xyz"[: view.dim], len(_ROWS[view.dim]): _ROWS[view.dim]}
        names = [str(name) for name in letters.get(width, range(width))]
        if component is None and width == view.dim:
            values, text = np.linalg.norm(rows, axis=1), f"{text}, magnitude"
        else:
            name = None if component is None else str(component)
            one_of(f"component of {field}", name, names)
            values, text = rows[:, names.index(name)], f"{text} {name}"
    sign = " (tension positive)" if field in _TENSION_POSITIVE else ""
    return values, f"{text}, {unit}{sign}" if unit else text


def _cut(ends: np.ndarray, plane) -> tuple[str, float, np.ndarray]:
    """Normal, place (m) and the numbers of the shapes that a plane cuts."""
    if plane is None:
        normal, at = "z", None
    else:
        try:
            normal, at = plane
        except (TypeError, ValueError):
            raise ValueError(
                f'plane must be an axis and a place in m, such as ("z", 0.5), got {plane!r}'
            ) from None
        normal, at = one_of("axis of plane", normal, _IN_PLANE), finite("place of plane", at)
    lower, upper = ends[:, :, "xyz".index(normal)].T
    low, high = lower.min(), upper.max()
    if at is None:
        centre = 0.5 * (lower + upper)
        at = float(centre[np.argmin(np.abs(centre - 0.5 * (low + high)))])
    cut = np.flatnonzero((lower <= at) & (at < upper))
    if not len(cut):
        cut = np.flatnonzero((lower <= at) & (at <= upper))
    if not len(cut):
        raise ValueError(
            f"plane: nothing lies at {normal} = {at:.6g} m; the bodies are between {low:.6g} and "
            f"{high:.6g} m"
        )
    return normal, at, cut


def _colours(values: np.ndarray) -> dict:
    """Map and limits: blue to red about zero where there are both signs, else viridis; what differs
    by round-off has one colour."""
    import matplotlib.pyplot as plt

    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    name, largest = "viridis", max(-low, high)
    if min(-low, high) > 0.01 * largest:  # a colour or more of the map's
        name, low, high = "RdBu_r", -largest, largest
    elif high - low <= 1e-9 * max(abs(low), abs(high)):
        margin = 0.05 * abs(low) or 1.0
        low, high = low - margin, high + margin
    return {"cmap": plt.get_cmap(name).with_extremes(bad="0.6"), "clim": (low, high)}
