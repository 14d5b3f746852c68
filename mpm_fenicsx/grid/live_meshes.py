"""How many meshes there are: each holds communicators of MPI, of which a process has some two
thousand, enough for about 200 runs at a time.

Runs refer to themselves, so that Python frees those that nobody asks for any more only when it
looks for them, and it may not look before communicators have run out, which ends the process.
"""

from __future__ import annotations

import gc
import weakref

MANY = 64
"""Meshes that are looked for from there on, and again after so many more."""

_live: weakref.WeakSet = weakref.WeakSet()
_most = MANY


def count(mesh):
    """``mesh``, counted; those that nobody asks for any more are freed where they have become
    many."""
    global _most
    if len(_live) >= _most:
        gc.collect()
        _most = len(_live) + MANY
    _live.add(mesh)
    return mesh
