"""How the equations of a step are solved: what a run is told of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..common.checks import an_object, finite
from .newton import Newton


@dataclass(frozen=True)
class Solver:
    """How the equations of a step are solved.

    ``newton``: when to stop where the response is not linear.
    ``petsc``: PETSc's options by name, without a dash, on top of what suits the run: conjugate
    gradients with an incomplete Cholesky factor in dynamics, a full factor in statics, GMRES and LU
    where the matrix is not symmetric.
    ``reuse``: a cell's density, moduli and part of the matrix stay as they are while they would
    change by less than that part (elastic material points, DOLFINx 0.11; else nothing is
    kept); a restart is one to round-off then.

    Raises ``ValueError`` for what is no option.
    """

    newton: Newton = field(default_factory=Newton)
    petsc: Mapping[str, object] | None = None
    reuse: float = 0.0

    def __post_init__(self) -> None:
        an_object("newton", self.newton, Newton, "Newton(tolerance)")
        if not 0.0 <= finite("reuse", self.reuse) <= 0.1:
            raise ValueError(f"reuse must be at least 0 and at most 0.1, got {self.reuse}")
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
