"""Files that appear when they are whole, and failures to write them that all ranks share."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .ranks import anywhere


def named(path: str | os.PathLike) -> Path:
    """The absolute path, or ``ValueError`` where it has no name."""
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"path must be a path, got {path!r}")
    text = os.fspath(path)
    if text.endswith(os.sep) or Path(text).name in ("", ".."):
        raise ValueError(f"path must end in a name, got {text!r}")
    return Path(text).absolute()


@contextmanager
def complete(file: Path) -> Iterator[Path]:
    """A name beside ``file`` to write to; takes the place of ``file`` if all goes well, else is
    removed."""
    part = file.with_name(file.name + ".part")
    try:
        yield part
        os.replace(part, file)
    finally:
        with suppress(OSError):
            part.unlink()


@contextmanager
def failing_together(comm, what: str, path: Path) -> Iterator[None]:
    """Make what goes wrong on any rank an ``OSError`` of every rank, which says ``what`` failed and
    ``path``.  Nothing inside may be collective."""
    failure = cause = None
    try:
        yield
    except Exception as error:
        cause = error
        failure = getattr(error, "errno", None) or 0, getattr(error, "strerror", None) or str(error)
    failure = anywhere(comm, failure)
    if failure:
        number, reason = failure
        raise OSError(number, f"{what}: {reason}", str(path)) from cause
