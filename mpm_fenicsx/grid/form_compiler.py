"""What a process that was killed while it compiled leaves behind: FFCx would wait for it in vain,
and then fail."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from mpi4py import MPI

from cffi import VerificationError

Built = TypeVar("Built")
ABANDONED = 60.0
"""Age of a source (s) that nobody compiles any more: no kernel keeps the compiler so long."""


def build(comm: MPI.Comm, make: Callable[[], Built]) -> Built:
    """What ``make`` returns; where it waits in vain for a source that another process has begun, it
    is called again once that source is compiled or, ``ABANDONED``, removed.  Collective on
    ``comm``.

    Raises: ``RuntimeError`` where the compiler fails, with what it takes; whatever else ``make``
    raises.
    """
    while True:
        try:
            return make()
        except (TimeoutError, RuntimeError, VerificationError) as error:
            # several ranks: RuntimeError, the reason on rank 0 only
            found = re.search(r"timed out.*remove (.+\.c)\)", str(error), re.DOTALL)
            failed = re.search(r"(?:Compile|Link|Platform)Error.*", str(error), re.DOTALL)
            source, reason = comm.bcast((found and found[1], failed and failed[0]), root=0)
            if reason is not None:
                raise RuntimeError(
                    f"a form could not be compiled ({reason}); DOLFINx takes a C compiler, which "
                    "CC names if it is not the usual one, and Python's headers: apt install gcc "
                    "python3-dev, or conda install -c conda-forge c-compiler"
                ) from error
            if source is None:
                raise
        if comm.rank == 0:
            _wait_for(Path(source))


def _wait_for(source: Path) -> None:
    """Return once ``source`` is compiled or gone."""
    while source.exists() and not source.with_suffix(".c.cached").exists():
        if time.time() - source.stat().st_mtime > ABANDONED:
            source.unlink(missing_ok=True)
        else:
            time.sleep(0.5)
