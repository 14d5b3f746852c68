"""Where compiled code is kept, if not where numba and DOLFINx would: an installation and a home may
be read-only."""

from __future__ import annotations

import os
import stat
import tempfile
import warnings
from pathlib import Path


def provide() -> None:
    """See that there is a folder for caches; where ``~/.cache`` takes none, name one of this user's
    in XDG_CACHE_HOME.

    Numba, which keeps kernels beside the package where it can, and DOLFINx go by that variable.
    DOLFINx does not start without a home, which a user whom the system does not know has only by
    HOME: where neither is there, HOME is ``/``.
    """
    if not os.path.isabs(os.path.expanduser("~")):
        os.environ["HOME"] = os.sep
    wanted = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    if _takes_files(wanted):
        return
    folder = _own_folder()
    os.environ["XDG_CACHE_HOME"] = str(folder)
    warnings.warn(
        f"compiled code cannot be kept in {wanted}: it is kept in {folder}; let XDG_CACHE_HOME "
        "name a folder that can be written, on several computers one that they share",
        UserWarning,
        stacklevel=4,
    )


def _takes_files(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _own_folder() -> Path:
    """A folder for temporary files that is this user's alone: code is read from it."""
    folder = Path(tempfile.gettempdir()) / f"mpm_fenicsx-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        if (
            stat.S_ISDIR(status.st_mode)
            and status.st_uid == os.getuid()
            and not status.st_mode & 0o077
        ):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="mpm_fenicsx-"))
