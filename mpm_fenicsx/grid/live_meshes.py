"""How many meshes there are: each holds communicators of MPI, of which a process has some two
thousand, enough for about 200 runs at a time.

Runs refer to themselves, so that Python frees those that nobody asks for any more only when it
looks for them, and it may not look before communicators have run out, which ends the process.
"""

from __future__ import annotations

import gc
import weakref

import ufl.corealg

MANY = 64
"""Meshes that are looked for from there on, and again after so many more."""

_live: weakref.WeakSet = weakref.WeakSet()
_most = MANY


def count(mesh):
    """``mesh``, counted; those that nobody asks for any more are freed where they have become
    many."""
    global _most
    _forget_visitors()
    if len(_live) >= _most:
        gc.collect()
        _most = len(_live) + MANY
    _live.add(mesh)
    return mesh


def _forget_visitors() -> None:
    """Let go of forms that UFL has gone through: from Python 3.12 on ``singledispatchmethod`` keeps
    each visitor by a method that refers to it, so that no such form, nor its mesh, was ever freed
    where it was compiled."""
    visitors = [getattr(getattr(ufl.corealg, "dag_traverser", None), "DAGTraverser", None)]
    while visitors:
        visitor = visitors.pop()
        if visitor is None:  # an older UFL
            return
        visitors += visitor.__subclasses__()
        kept = getattr(vars(visitor).get("process"), "_method_cache", None)
        if kept is not None:
            kept.clear()
