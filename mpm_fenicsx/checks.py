"""Refusals: bad input is named, with its value, before it can do harm."""

from __future__ import annotations

import math
from collections.abc import Iterable


def finite(name: str, value: float) -> float:
    """Return ``value`` as a float, or raise ``ValueError`` naming it if it is not a finite number."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number, got {value!r}") from None
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number}")
    return number


def positive(name: str, value: float) -> float:
    """Return ``value`` as a float, or raise ``ValueError`` naming it if it is not finite and > 0."""
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
    """Return ``value`` as an int, or raise ``ValueError`` naming it if it is not whole and >= ``least``."""
    number = finite(name, value)
    if number != int(number) or number < least:
        raise ValueError(f"{name} must be a whole number of at least {least}, got {value!r}")
    return int(number)


def one_of(name: str, value: str, known: Iterable[str]) -> str:
    """Return ``value``, or raise ``ValueError`` naming it and what is known."""
    known = list(known)
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(known)}, got {value!r}")
    return value
