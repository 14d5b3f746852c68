"""What a load may be: numbers, or a function of time, or of time and place."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np

from ..common.checks import in_short, numbers

PLACES = ("x", "xs", "place", "places", "position", "positions", "point", "points", "coordinates")
TIMES = ("t", "time")
TRIALS = 5
"""Places that a load is asked for when it is taken: another number than components, so that rows
show."""


class Load:
    """Load at time t (s) and places x (n, dim): (dim,) or (n, dim).  Where a rank has no places,
    the function is not asked: it may be written for some.

    ``fault``: what was wrong with it when it last was no number, or None; a step reads it on all
    ranks together.
    """

    def __init__(self, name: str, function: Callable[[float, np.ndarray], np.ndarray], dim: int):
        self.name, self.function, self.dim, self.fault = name, function, dim, None

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        if not len(x):
            return np.zeros((0, self.dim))
        try:
            given = self.function(t, x)
            value = numbers(given)
        except Exception as error:  # on one rank, perhaps: all are told
            self.fault = f"{self.name} raises {type(error).__name__} at t = {t:.6g}: {error}"
            return np.zeros(self.dim)
        if value is None or value.shape not in ((self.dim,), (len(x), self.dim)):
            self.fault = (
                f"{self.name} must give {self.dim} finite numbers, got "
                f"{in_short(given) if value is None else repr(value)} at t = {t:.6g}"
            )
            return np.zeros(self.dim)
        there = np.isfinite(value)
        if not there.all():
            row = np.flatnonzero(~there.reshape(-1, self.dim).all(axis=1))[0]
            at, where = (value, "") if value.ndim == 1 else (value[row], f", x={x[row]}")
            self.fault = f"{self.name} must be finite, got {at} at t = {t:.6g}{where}"
        return value


def combined(load: Load, start: float, end: float, x: np.ndarray, weight: float) -> np.ndarray:
    """Load at the end of a step and, where ``weight`` is not zero, so much of that at its start on
    top."""
    value = load(end, x)
    return value + weight * load(start, x) if weight else value


def as_load(name: str, value, dim: int, places: np.ndarray | None = None) -> tuple[Load, bool]:
    """A load as a function of time and place, and whether it depends on place.

    ``value``: (dim,) numbers, or whatever can be called with t, or with t and x (n, dim): see
    ``takes_place``.  It is tried at t = 0 and ``places`` (n, dim), m, where it may be asked for.
    Raises ``ValueError`` naming ``name``.
    """
    wanted = f"{name} must give {dim} finite numbers, got"
    x = np.zeros((TRIALS, dim)) if places is None else places
    if not callable(value):
        constant = numbers(value)
        if constant is None:
            raise ValueError(f"{wanted} {value!r}")
        function, placed = (lambda t, x: constant), False
    else:
        function, placed = _as_function(name, value, x)
    try:
        with np.errstate(all="ignore"):
            result = function(0.0, x)
    except Exception as error:
        raise ValueError(f"{wanted} {value!r}, which says at t=0: {_words(error)}") from error
    trial = numbers(result)
    if trial is None or trial.shape not in ([(dim,), (len(x), dim)] if placed else [(dim,)]):
        raise ValueError(f"{wanted} {result if trial is None else trial!r} at t=0")
    there = np.isfinite(trial)
    if not (
        there.any() if trial.ndim == 2 else there.all()
    ):  # at some places there may be none: no body is there
        raise ValueError(f"{wanted} {trial!r} at t=0")
    return Load(name, function, dim), placed


def of_time(name: str, value) -> Callable[[float], float]:
    """A number that is a function of time: whatever can be called with t (s) and gives one finite
    number.

    Raises ``ValueError`` naming ``name``, here for what cannot be called, or is not a number at t =
    0.
    """
    if not callable(value):
        raise ValueError(
            f"{name} must be a function of time, such as lambda t: 0.01 * t, got {value!r}"
        )

    def function(t: float) -> float:
        try:
            given = value(t)
        except Exception as error:
            kind = type(error).__name__
            raise ValueError(f"{name} raises {kind} at t = {t:.6g}: {error}") from error
        result = numbers(given)
        if result is None or result.size != 1 or not np.isfinite(result).all():
            raise ValueError(
                f"{name} must be one finite number, got "
                f"{in_short(given) if result is None else repr(result)} at t = {t:.6g}"
            )
        return float(result.reshape(()))

    if takes_place(value):
        raise ValueError(
            f"{name} must be a function of time alone, got {value!r}, which takes a place too"
        )
    try:
        function(0.0)
    except Exception as error:
        raise ValueError(
            f"{name} must be a function of time, got {value!r}, which says at t=0: {_words(error)}"
        ) from error
    return function


def takes_place(function: Callable) -> bool | str | None:
    """Whether a function of time is one of place, too; None where only a call can tell.

    It is so by a second positional parameter that is required, or is one of ``PLACES``; or, as its
    name, by one of ``PLACES`` that comes later.  What has a default is not asked for.
    """
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):  # some built-in and compiled functions do not say
        return None
    kinds = inspect.Parameter
    positional = [
        p for p in parameters if p.kind in (kinds.POSITIONAL_ONLY, kinds.POSITIONAL_OR_KEYWORD)
    ]
    if len(positional) > 1 and (
        positional[1].default is kinds.empty or positional[1].name in PLACES
    ):
        return True
    named = [
        p.name
        for p in (*positional[2:], *(p for p in parameters if p.kind is kinds.KEYWORD_ONLY))
        if p.name in PLACES and (p.kind is kinds.POSITIONAL_OR_KEYWORD or p.default is kinds.empty)
    ]
    if named:
        return named[0]
    return (
        None
        if any(p.kind is kinds.VAR_POSITIONAL for p in parameters) and len(positional) < 2
        else False
    )


def _as_function(name: str, value: Callable, x: np.ndarray) -> tuple[Callable, bool]:
    """``value`` as a function of time and places, and whether it depends on them."""
    place = takes_place(value)
    if place is None:
        place = not _serves(value, 0.0) and _serves(value, 0.0, x)
    if isinstance(place, str):
        return (lambda t, x: value(t, **{place: x})), True
    if not place:
        return (lambda t, x: value(t)), False
    if _swapped(value):
        raise ValueError(
            f"{name} must take time before place, f(t, x), got {value!r}, which takes place first"
        )
    return (lambda t, x: value(t, x)), True


def _serves(function: Callable, *arguments) -> bool:
    try:
        return numbers(function(*arguments)) is not None
    except Exception:
        return False


def _swapped(function: Callable) -> bool:
    try:
        names = list(inspect.signature(function).parameters)[:2]
    except (TypeError, ValueError):
        return False
    return len(names) == 2 and names[0] in PLACES and names[1] in TIMES


def _words(error: Exception) -> str:
    return (
        f"{error}"
        if isinstance(error, TypeError | ValueError)
        else f"{type(error).__name__}: {error}"
    )
