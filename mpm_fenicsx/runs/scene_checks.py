"""What the arguments of a run must be: each is told from what is often given in its place."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from ..common.checks import an_object, in_short, several
from ..dynamics.time_stepping import Newmark, QuasiStatic
from ..grid.grid import Grid
from ..points.material_points import MaterialPoints


def terms_of(terms) -> list:
    """The terms as a list; one alone may be given without one.  Raises ``ValueError`` naming what
    is no term."""
    terms = (
        [terms]
        if hasattr(terms, "bind")
        else several("terms", terms, "a list such as [Gravity((0, -9.81))]")
    )
    for n, term in enumerate(terms):
        if isinstance(term, type) or not callable(getattr(term, "bind", None)):
            raise ValueError(
                f"terms: number {n} is no boundary or load such as Gravity((0, -9.81)), got "
                f"{in_short(term)}"
            )
    return terms


def bodies_of(bodies) -> list[MaterialPoints]:
    """The bodies as a list; one alone may be given without one.  Raises ``ValueError`` naming what
    is no body."""
    such_as = (
        "MaterialPoints, one body or a list of bodies, such as MaterialPoints.fill(grid, material, "
        "4)"
    )
    alone = isinstance(bodies, MaterialPoints | type)
    bodies = [bodies] if alone else several("bodies", bodies, such_as)
    if not bodies:
        raise ValueError("bodies: there is no body")
    if any(a is b for a, b in combinations(bodies, 2)):
        raise ValueError("bodies: a body is named twice")
    return [an_object("bodies", body, MaterialPoints, such_as) for body in bodies]


def check_run(grid, stepping) -> None:
    """Raise ``ValueError`` for a grid or a stepping that is none."""
    an_object("grid", grid, Grid, "a Grid, such as Grid.box((0, 0), (2, 1), (20, 10))")
    an_object("stepping", stepping, (Newmark, QuasiStatic), "Newmark(dt) or QuasiStatic(steps)")


def refuse_other_scenes(comm, words: Sequence[str]) -> None:
    """Raise ``ValueError``, on all ranks, where one makes another run, told by ``words``, than the
    first: they would wait for one another for ever.  Collective."""
    if comm.size == 1:
        return
    first, *others = comm.allgather(list(words))
    for rank, other in enumerate(others, start=1):
        for here, there in zip(first, other, strict=True):
            if here != there:
                raise ValueError(
                    f"rank 0 makes a run with {here}, and rank {rank} one with {there}: a script "
                    "gives the same grid, bodies, terms and step on every rank, also where a rank "
                    "holds no point of a surface"
                )


def pairs_of(bodies: Sequence, run: type, surface: type) -> list[tuple]:
    """Pairs of a run and a surface, two or more.  Raises ``ValueError`` for what are none."""
    wanted = f"bodies: contact takes two or more pairs ({run.__name__}, {surface.__name__}), got"
    if (
        len(bodies) == 1
        and isinstance(bodies[0], list)
        and all(isinstance(b, tuple) for b in bodies[0])
    ):
        bodies = bodies[0]
    if len(bodies) < 2:
        raise ValueError(f"{wanted} {len(bodies)}")
    for pair in bodies:
        if (
            not isinstance(pair, tuple | list)
            or len(pair) != 2
            or not isinstance(pair[0], run)
            or not isinstance(pair[1], surface)
        ):
            parts = pair if isinstance(pair, tuple | list) else [pair]
            got = ", ".join(type(part).__name__ for part in parts)
            raise ValueError(f"{wanted} ({got})")
    return list(bodies)
