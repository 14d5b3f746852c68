"""What the arguments of a run must be: each is told from what is often given in its place."""

from __future__ import annotations

from collections.abc import Mapping as Options
from collections.abc import Sequence

from ..common.checks import an_object, in_short, several
from ..dynamics.time_stepping import Newmark, QuasiStatic
from ..grid.grid import Grid
from ..mapping.methods import Mapping
from ..points.material_points import MaterialPoints
from ..solver.newton import Newton


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


def bodies_of(points) -> list[MaterialPoints]:
    """The bodies as a list; one alone may be given without one.  Raises ``ValueError`` naming what
    is no body."""
    such_as = (
        "MaterialPoints, one body or a list of bodies, such as MaterialPoints.fill(grid, material, "
        "4)"
    )
    points = (
        [points]
        if isinstance(points, MaterialPoints | type)
        else several("points", points, such_as)
    )
    if not points:
        raise ValueError("points: there is no body")
    if len({id(body) for body in points}) < len(points):
        raise ValueError("points: a body is named twice")
    return [an_object("points", body, MaterialPoints, such_as) for body in points]


def check_run(grid, stepping) -> None:
    """Raise ``ValueError`` for a grid or a stepping that is none."""
    an_object("grid", grid, Grid, "a Grid, such as Grid.box((0, 0), (2, 1), (20, 10))")
    an_object("stepping", stepping, (Newmark, QuasiStatic), "Newmark(dt) or QuasiStatic(steps)")


def check_options(newton, solver, **flags) -> None:
    """Raise ``ValueError`` for options of a run that are none: ``flags`` must be True or False."""
    if newton is not None:
        an_object("newton", newton, Newton, "Newton(tolerance) or None")
    if solver is not None:
        an_object(
            "solver",
            solver,
            Options,
            'PETSc options by name, such as {"ksp_type": "cg", "ksp_rtol": 1e-10}',
        )
        for key in solver:
            if not isinstance(key, str) or key.startswith("-"):
                raise ValueError(
                    f"solver: names of PETSc options are texts without a dash, got {key!r}"
                )
    for name, value in flags.items():
        if value not in (True, False):
            raise ValueError(f"{name} must be True or False, got {value!r}")


def check_mapping(mapping, transfer) -> None:
    """Raise ``ValueError`` for a mapping or a transfer that is none."""
    an_object("mapping", mapping, Mapping, "an object such as DM_GC, imported by its name")
    if not callable(transfer) or isinstance(transfer, type):
        raise ValueError(
            f"transfer must be a function such as trapezoidal or flip, got {transfer!r}"
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
