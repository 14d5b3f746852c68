"""How the equations of a step are solved: what a run is told of it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from ..common.checks import an_object, finite
from .newton import Newton

PREFIX = re.compile(r"|[A-Za-z]\w*_")


@dataclass(frozen=True)
class Solver:
    """How the equations of a step are solved.

    ``newton``: when to stop where the response is not linear.
    ``petsc``: PETSc's options by name, without a dash, on top of what suits the run.  That is in
    dynamics conjugate gradients with an incomplete Cholesky factor, on several ranks with Jacobi's
    preconditioner; in statics a full factor; algebraic multigrid where statics are large or steps
    long; GMRES and LU where the matrix is not symmetric.  ``print(run)`` says which, and why.
    ``prefix``: options in PETSc's table that begin so are on top of these, "soil\\_" for
    ``-soil_ksp_rtol 1e-8`` on the command line (after ``petsc4py.init(sys.argv)``), in the
    variable PETSC_OPTIONS or in a file ``.petscrc``.  They are read when a run is made.
    ``reuse``: a cell's density, moduli and part of the matrix stay as they are while they would
    change by less than that part (elastic material points, DOLFINx 0.11; else nothing is
    kept); a restart is one to round-off then.

    Raises ``ValueError`` for what is no option.
    """

    newton: Newton = field(default_factory=Newton)
    petsc: Mapping[str, object] | None = None
    reuse: float = 0.0
    prefix: str = ""

    def __post_init__(self) -> None:
        an_object("newton", self.newton, Newton, "Newton(tolerance)")
        if not 0.0 <= finite("reuse", self.reuse) <= 0.1:
            raise ValueError(f"reuse must be at least 0 and at most 0.1, got {self.reuse}")
        if not isinstance(self.prefix, str) or not (PREFIX.fullmatch(self.prefix)):
            raise ValueError(
                'prefix must be a text without a dash that ends with an underscore, such as "soil_"'
                f", got {self.prefix!r}"
            )
        if self.petsc is None:
            return
        an_object(
            "petsc",
            self.petsc,
            Mapping,
            'PETSc options by name, such as {"ksp_type": "cg", "ksp_rtol": 1e-10}',
        )
        for key in self.petsc:
            if not isinstance(key, str) or key.startswith("-"):
                raise ValueError(
                    f"petsc: names of PETSc options are texts without a dash, got {key!r}"
                )
