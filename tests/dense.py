"""Dense matrices and small scenes for the tests, on one rank."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from mpm_fenicsx import Grid, LinearElastic, MaterialPoints, fenicsx
from mpm_fenicsx.motion import Motion
from mpm_fenicsx.scene import Scene

SOIL = LinearElastic(young=20e6, poisson=0.25, density=1500.0)
SOFT = LinearElastic(young=3e6, poisson=0.3, density=1800.0)
LINES = np.array([0.0, 0.3, 0.8, 1.0])


def uneven(dim: int) -> Grid:
    """Grid of 3^dim uneven cells on the unit square or cube."""
    return Grid.rectilinear([LINES**power for power in (1.0, 1.3, 0.8)[:dim]])


def random_body(grid: Grid, rng, inside=None, material=SOIL, jitter: float = 0.4) -> MaterialPoints:
    """Randomly placed points with random stress, velocity and acceleration."""
    body = MaterialPoints.fill(grid, material, 2**grid.dim, inside=inside, jitter=jitter, seed=int(rng.integers(1000)))
    body.stress[:] = 1e5 * rng.normal(size=body.stress.shape)
    body.velocity, body.acceleration = rng.normal(size=(2, *body.x.shape))
    return body


def dense(A) -> np.ndarray:
    """Entries of a PETSc matrix."""
    start, column, value = A.getValuesCSR()
    return csr_matrix((value, column, start), shape=A.getSize()).toarray()


def matrix(form) -> np.ndarray:
    """Dense matrix of a bilinear form, without boundary conditions."""
    compiled = fenicsx.compile_form(form)
    A = fenicsx.create_matrix(compiled)
    fenicsx.assemble_matrix(A, compiled, [])
    A.assemble()
    return dense(A)


def vector(V, form) -> np.ndarray:
    """Vector of a linear form."""
    from dolfinx import fem

    b = fem.Function(V)
    fenicsx.assemble_vector(b, fenicsx.compile_form(form))
    return b.x.array.copy()


def bare_scene(grid: Grid, stepping) -> Scene:
    """A scene without points: what terms alone need."""
    return Scene(grid, Motion(grid, stepping), 1.0, grid.dx)


def at_nodes(grid: Grid, function) -> np.ndarray:
    """Values (dofs,) of function(x (nodes, dim)) -> (nodes, dim)."""
    return function(grid.space.tabulate_dof_coordinates()[:, : grid.dim]).ravel()
