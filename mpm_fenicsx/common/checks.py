"""Refusals: bad input is named, with its value, before it can do harm."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np


def finite(name: str, value: float) -> float:
    """Return ``value`` as a float, or raise ``ValueError`` naming it if it is not a finite
    number."""
    try:
        number = float(_of_numbers(value))
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number, got {value!r}") from None
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number}")
    return number


def positive(name: str, value: float) -> float:
    """Return ``value`` as a float, or raise ``ValueError`` naming it if it is not finite and >
    0."""
    number = finite(name, value)
    if number <= 0.0:
        raise ValueError(f"{name} must be positive, got {number}")
    return number


def between(name: str, value: float, low: float, high: float) -> float:
    """Return ``value`` as a float, or raise ``ValueError`` naming it unless low < value < high."""
    number = finite(name, value)
    if not low < number < high:
        raise ValueError(f"{name} must lie between {low} and {high}, both excluded, got {number}")
    return number


def whole(name: str, value: int, least: int = 1) -> int:
    """Return ``value`` as an int, or raise ``ValueError`` naming it if it is not whole and >=
    ``least``; True and False are none."""
    number = finite(name, value)
    if isinstance(value, bool | np.bool_) or number != int(number) or number < least:
        raise ValueError(f"{name} must be a whole number of at least {least}, got {value!r}")
    return int(number)


def one_of(name: str, value: str, known: Iterable[str]) -> str:
    """Return ``value``, or raise ``ValueError`` naming it and what is known."""
    known = list(known)
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(known)}, got {value!r}")
    return value


def an_object(name: str, value, kind: type | tuple[type, ...], such_as: str):
    """Return ``value``, or raise ``ValueError`` naming it and what it should be like, if it is not
    of ``kind``."""
    if isinstance(value, kind):
        return value
    raise ValueError(f"{name} must be {such_as}, got {in_short(value)}")


def in_short(value) -> str:
    """What ``value`` is, in a line that a message can bear."""
    if isinstance(value, type):
        return f"the class {value.__name__} itself"
    text = " ".join(repr(value).split())
    return text if len(text) <= 100 else f"{text[:90]}…"


def several(name: str, value, such_as: str) -> list:
    """Return ``value`` as a list, or raise ``ValueError`` naming it if it cannot be gone through,
    or is text."""
    if isinstance(value, str | bytes | dict) or not isinstance(value, Iterable):
        raise ValueError(f"{name} must be {such_as}, got {in_short(value)}")
    return list(value)


def array(name: str, value) -> np.ndarray:
    """Return ``value`` as a new array of floats, or raise ``ValueError`` naming it if it is
    none."""
    found = numbers(value)
    if found is None:
        raise ValueError(f"{name} must be an array of numbers, got {value!r}")
    return found


def numbers(value) -> np.ndarray | None:
    """An array of floats, a copy, or None for what is none: text and complex numbers are not."""
    try:
        return None if value is None else np.array(_of_numbers(value), float, order="C")
    except (TypeError, ValueError):
        return None


def _of_numbers(value):
    """``value``, or ``TypeError`` for what NumPy would make numbers of, and is text or complex."""
    if not isinstance(value, float | int) and np.asarray(value).dtype.kind in "SUc":
        raise TypeError
    return value


def asked(name: str, function: Callable[[np.ndarray], object], x: np.ndarray):
    """What a user's function says of the places x (dim, n), or raise ``ValueError`` naming it where
    it raises."""
    try:
        return function(x)
    except Exception as error:
        raise ValueError(f"{name} raises {type(error).__name__}: {error}") from error


def chosen(name: str, function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """Which of the places x (dim, n) a function of x chooses, bool (n,), or raise ``ValueError``
    naming it if that is not what it says, or raises an error."""
    if not callable(function):
        raise ValueError(f"{name} must be a function of x (dim, n), got {in_short(function)}")
    answer, (dim, n) = np.asarray(asked(name, function, x)), x.shape
    if answer.shape != (n,):
        one_place = (
            "; coordinates y are x[1]: x[:, 1] is one place" if answer.shape == (dim,) else ""
        )
        raise ValueError(
            f"{name} must map (dim, n) to (n,), gave {answer.shape} for n={n}{one_place}"
        )
    if answer.dtype.kind != "b":
        numeric = answer.dtype.kind in "iuf"
        wrong = answer[(answer != 0) & (answer != 1)] if numeric else answer
        if len(wrong):
            raise ValueError(
                f"{name} must say True or False of each place, as lambda x: x[1] < 1 does, gave "
                f"{wrong[0]!s}"
            )
    return answer.astype(bool)


def increasing(name: str, value: Sequence[float]) -> np.ndarray:
    """Return ``value`` as an array of two or more numbers, each larger than the one before, or
    raise ``ValueError``."""
    line = array(name, value)
    if (
        line.ndim != 1
        or len(line) < 2
        or not np.isfinite(line).all()
        or not (np.diff(line) > 0).all()
    ):
        raise ValueError(f"{name} must increase, got {value}")
    return line


def check_flags(**flags) -> None:
    """Raise ``ValueError`` naming what is neither True nor False."""
    for name, value in flags.items():
        if value not in (True, False):
            raise ValueError(f"{name} must be True or False, got {value!r}")
