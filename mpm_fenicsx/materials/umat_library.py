"""Compiled libraries of users: loading them, and the addresses of their routines."""

from __future__ import annotations

import ctypes
import difflib
import hashlib
import os
import re
from pathlib import Path

_LOADED: dict[str, tuple[str, ctypes.CDLL]] = {}
"""What this process has loaded, by path: fingerprint and handle."""


def fingerprint(path: str) -> str:
    """The first sixteen digits of the SHA-256 of a library, which tell one build from another.

    Raises ``ValueError`` where there is no such file.
    """
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise ValueError(
            f"library must be a compiled library that can be read, got {path!r}: {error.strerror}; "
            "gfortran -shared -fPIC -O2 -o mine.so mine.f makes one"
        ) from error


def address(path: str, build: str, symbol: str) -> int:
    """Where the routine ``symbol`` begins, in this process.

    Raises ``ValueError`` for a file that is no library, that needs routines that nobody has, that
    lacks the symbol, or of which this process has loaded another ``build``.
    """
    library = _load(path, build)
    try:
        return ctypes.cast(getattr(library, symbol), ctypes.c_void_p).value
    except AttributeError:
        raise ValueError(
            f"symbol {symbol!r} is not in library {path}, {_instead(path, library, symbol)}"
        ) from None


def _load(path: str, build: str) -> ctypes.CDLL:
    if path in _LOADED:
        known, library = _LOADED[path]
        if known != build:
            raise ValueError(
                f"library {path} was built anew after this process had loaded it, and the old one "
                "would go on being called: start Python anew, or give the new build another name"
            )
        return library
    try:
        library = ctypes.CDLL(path)
    except OSError as error:
        raise ValueError(f"library {path} cannot be loaded: {_cure(str(error))}") from error
    _LOADED[path] = build, library
    return library


def _cure(reason: str) -> str:
    """What the loader says, and what helps."""
    lacking = re.search(r"undefined symbol: (\w+)", reason)
    if lacking:
        return (
            f"it calls {lacking[1]}, which is not in it; compile a file that has this routine into "
            "the library, also one of Abaqus's own such as XIT or SINV, or link what has it by -l"
        )
    if "invalid ELF header" in reason or "file too short" in reason or "ELF" in reason:
        return (
            f"{reason}; it must be a shared library for this machine, not source or an object file:"
            " gfortran -shared -fPIC -O2 -o mine.so mine.f"
        )
    return reason


def _instead(path: str, library: ctypes.CDLL, symbol: str) -> str:
    """Which of its routines may be meant."""
    words = set(re.findall(rb"[A-Za-z_][A-Za-z0-9_]{2,}", Path(path).read_bytes()))
    names = {word.decode() for word in words}
    stem = symbol.strip("_").lower()
    near = {name for name in names if stem in name.lower()}
    near |= set(difflib.get_close_matches(symbol, names, n=8))
    near = sorted(name for name in near if hasattr(library, name))
    if not near:
        return "nor is any name near it: gfortran makes of SUBROUTINE UMAT the symbol umat_"
    mangled = any(name.startswith("_Z") for name in near)
    cure = '; declare it extern "C"' if mangled else ""
    return f"which has {', '.join(near)}: give symbol={near[0]!r}{cure}"


def absolute(path: str | os.PathLike) -> str:
    """The path from the root, so that a run that changes its folder still finds it."""
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"library must be the path of a compiled library, got {path!r}")
    return str(Path(os.fspath(path)).expanduser().absolute())
