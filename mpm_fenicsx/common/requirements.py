"""What has to be there before the package can be used, and words where it is not."""

from __future__ import annotations

from . import caches

caches.provide()  # before DOLFINx is imported, which looks once

HOW = """
    pip install "mpm_fenicsx[wheel]"  (Python 3.12 or later; in a copy of the source ".[wheel]")
    conda install -c conda-forge fenics-dolfinx
    apt install python3-dolfinx-real  (Debian 12 or later)
The first takes mpi4py and PETSc along; a plain "pip install mpm_fenicsx" does not, lest it
overwrites those of conda and apt."""

try:
    from mpi4py import MPI  # noqa: F401  before dolfinx: it loads the MPI library of the wheel

    import dolfinx  # noqa: F401
    from petsc4py import PETSc
except ImportError as error:
    raise ImportError(
        "mpm_fenicsx runs on DOLFINx with mpi4py and petsc4py, and not all of them can be "
        f"imported ({error}). Install them by one of{HOW}",
        name=error.name,
    ) from error
if PETSc.ScalarType().dtype.kind == "c":
    raise ImportError(
        "mpm_fenicsx needs DOLFINx with PETSc of real numbers, and this one has complex numbers: "
        "python3-dolfinx-real of Debian, or petsc=*=real* of conda"
    )
