"""What a load may be: numbers, or a function of time, or of time and place."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np


class Load:
    """Load at time t (s) and places x (n, dim): (dim,) or (n, dim).

    ``fault``: what was wrong with it when it last was no number, or None; a step reads it on all ranks together.
    """

    def __init__(self, name: str, function: Callable[[float, np.ndarray], np.ndarray]):
        self.name, self.function, self.fault = name, function, None

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        value = self.function(t, x)
        there = np.isfinite(value)
        if not there.all():
            row = np.flatnonzero(~there.reshape(-1, there.shape[-1]).all(axis=1))[0]
            at, where = (value, "") if value.ndim == 1 else (value[row], f", x={x[row]}")
            self.fault = f"{self.name} must be finite, got {at} at t = {t:.6g}{where}"
        return value


def combined(load: Load, start: float, end: float, x: np.ndarray, weight: float) -> np.ndarray:
    """Load at the end of a step and, where ``weight`` is not zero, so much of that at its start on top."""
    value = load(end, x)
    return value + weight * load(start, x) if weight else value


def as_load(name: str, value, dim: int) -> tuple[Load, bool]:
    """A load as a function of time and place, and whether it depends on place.

    ``value``: (dim,) numbers, or a function of t, or of t and x (n, dim).  Raises ``ValueError`` naming ``name``.
    """
    try:
        if not callable(value):
            constant = np.array(value, float)
            function, placed = (lambda t, x: constant), False
        elif len(inspect.signature(value).parameters) >= 2:
            function, placed = (lambda t, x: np.asarray(value(t, x), float)), True
        else:
            function, placed = (lambda t, x: np.asarray(value(t), float)), False
        trial = function(0.0, np.zeros((3, dim)))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must give {dim} finite numbers, got {value!r}: {error}") from error
    if trial.shape not in ([(dim,), (3, dim)] if placed else [(dim,)]) or not np.isfinite(trial).all():
        raise ValueError(f"{name} must give {dim} finite numbers, got {trial!r} at t=0")
    return Load(name, function), placed
