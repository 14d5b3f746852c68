"""What a term or a material is, in words that are the same in every process: for checkpoints."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from dolfinx import fem

from ..common.checks import numbers
from ..grid.grid import GridSurface
from ..points.surface_points import SurfacePoints
from ..response.cell_materials import CellMaterials

FEW = 6
"""So many numbers are named one by one."""


def described(thing) -> str:
    """Numbers as they are, arrays by shape and fingerprint, functions by name alone: what is in
    them is not seen.  Fields that do not count in comparisons are left out: a library's path."""
    if dataclasses.is_dataclass(thing) and not isinstance(
        thing, GridSurface | SurfacePoints | type
    ):
        parts = {
            f.name: getattr(thing, f.name, None) for f in dataclasses.fields(thing) if f.compare
        }
        return f"{type(thing).__name__}({_together(parts)})"
    if thing is None or isinstance(thing, str | bool):
        return repr(thing)
    if isinstance(thing, GridSurface):
        return f"facets {', '.join(thing.names)}"
    if isinstance(thing, SurfacePoints):
        return "surface points"  # places and areas are part of the state, and compared there
    if isinstance(thing, CellMaterials):
        return repr(thing)
    if isinstance(thing, fem.Function):
        return f"field {_fingerprint(thing.x.array)}"
    if isinstance(thing, type):
        return thing.__name__
    if not callable(thing):
        array = numbers(thing)
        if array is not None:
            return (
                repr(array.tolist())
                if array.size <= FEW
                else f"array {array.shape} {_fingerprint(array)}"
            )
    name = getattr(thing, "__name__", None) or getattr(
        getattr(thing, "func", None), "__name__", None
    )
    if name is not None:
        return name
    mine = {
        key: value
        for key, value in getattr(thing, "__dict__", {}).items()
        if isinstance(value, str) or (not callable(value) and numbers(value) is not None)
    }
    return f"{type(thing).__name__}({_together(mine)})" if mine else type(thing).__name__


def _together(parts: dict) -> str:
    return ", ".join(f"{name}={described(value)}" for name, value in parts.items())


def _fingerprint(array: np.ndarray) -> str:
    """Norm, and sum with weights that tell places apart, to six digits: the same but for
    round-off."""
    flat = np.asarray(array, float).ravel()
    norm = math.sqrt(float(flat @ flat))
    mixed = float(flat @ np.cos(np.arange(len(flat)) ** 2)) / norm if norm > 0.0 else 0.0
    return f"{norm:.6g}, {mixed:.5f}"
