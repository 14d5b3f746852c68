"""Dense matrices and small scenes for the tests, on one rank."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from mpm_fenicsx import Grid, LinearElastic, MaterialPoints
from mpm_fenicsx.dynamics.motion import Motion
from mpm_fenicsx.grid import dolfinx_versions
from mpm_fenicsx.terms.scene import Scene

SOIL = LinearElastic(young=20e6, poisson=0.25, density=1500.0)
SOFT = LinearElastic(young=3e6, poisson=0.3, density=1800.0)
LINES = np.array([0.0, 0.3, 0.8, 1.0])


def uneven(dim: int) -> Grid:
    """Grid of 3^dim uneven cells on the unit square or cube."""
    return Grid.rectilinear([LINES**power for power in (1.0, 1.3, 0.8)[:dim]])


def random_body(grid: Grid, rng, inside=None, material=SOIL, jitter: float = 0.4) -> MaterialPoints:
    """Randomly placed points with random stress, velocity and acceleration."""
    body = MaterialPoints.fill(
        grid, material, 2**grid.dim, inside=inside, jitter=jitter, seed=int(rng.integers(1000))
    )
    body.stress[:] = 1e5 * rng.normal(size=body.stress.shape)
    body.velocity, body.acceleration = rng.normal(size=(2, *body.x.shape))
    return body


def dense(A) -> np.ndarray:
    """Entries of a PETSc matrix."""
    start, column, value = A.getValuesCSR()
    return csr_matrix((value, column, start), shape=A.getSize()).toarray()


def matrix(form) -> np.ndarray:
    """Dense matrix of a bilinear form, without boundary conditions."""
    compiled = dolfinx_versions.compile_form(form)
    A = dolfinx_versions.create_matrix(compiled)
    dolfinx_versions.assemble_matrix(A, compiled, [])
    A.assemble()
    return dense(A)


def vector(V, form) -> np.ndarray:
    """Vector of a linear form."""
    from dolfinx import fem

    b = fem.Function(V)
    dolfinx_versions.assemble_vector(b, dolfinx_versions.compile_form(form))
    return b.x.array.copy()


def bare_scene(grid: Grid, stepping) -> Scene:
    """A scene without points: what terms alone need."""
    return Scene(grid, Motion(grid, stepping), 1.0, grid.dx)


def at_nodes(grid: Grid, function) -> np.ndarray:
    """Values (dofs,) of function(x (nodes, dim)) -> (nodes, dim)."""
    return function(grid.space.tabulate_dof_coordinates()[:, : grid.dim]).ravel()


def hats(grid: Grid, x: np.ndarray) -> np.ndarray:
    """Bilinear (trilinear) shape functions (n, nodes) at x (n, dim), from the nodes' coordinates
    alone."""
    nodes = grid.space.tabulate_dof_coordinates()[:, : grid.dim]
    out = np.ones((len(x), len(nodes)))
    for d in range(grid.dim):
        line = nodes[np.unique(nodes[:, d].round(12), return_index=True)[1], d]
        place = np.abs(nodes[:, d, None] - line).argmin(axis=1)
        out *= np.stack([np.interp(x[:, d], line, row) for row in np.eye(len(line))], 1)[:, place]
    return out


def over_faces(grid: Grid, surface, values: np.ndarray) -> np.ndarray:
    """Σ ∫ f N_i dA (nodes, columns) over a surface's faces (2D) with f A linear through ``values``
    (n, columns) at their Gauss points, piece by piece between all lines of the grid."""
    nodes, total = grid.space.tabulate_dof_coordinates()[:, :2], 0.0
    ξ, w = np.polynomial.legendre.leggauss(4)
    for x, v in zip(
        surface.x.reshape(-1, 2, 2), values.reshape(len(surface) // 2, 2, -1), strict=True
    ):
        centre, half = x.mean(axis=0), np.sqrt(0.75) * (x[1] - x[0])
        with np.errstate(divide="ignore", invalid="ignore"):
            cuts = np.concatenate(
                [(np.unique(nodes[:, d].round(12)) - centre[d]) / half[d] for d in range(2)]
            )
        ends = np.unique([-1.0, *cuts[np.abs(cuts) < 1.0], 1.0])
        middle, reach = (ends[1:] + ends[:-1]) / 2, np.diff(ends) / 2
        s = (middle[:, None] + np.outer(reach, ξ)).ravel()
        f = v.mean(axis=0) + np.sqrt(0.75) * s[:, None] * (v[1] - v[0])
        total = total + hats(grid, centre + s[:, None] * half).T @ (
            np.outer(reach, w).reshape(-1, 1) * f
        )
    return total


def rotation(rng, dim: int) -> np.ndarray:
    """A random rotation matrix."""
    Q, R = np.linalg.qr(rng.normal(size=(dim, dim)))
    Q *= np.sign(np.diag(R))
    Q[:, 0] *= np.linalg.det(Q)
    return Q


def spin(x: np.ndarray) -> np.ndarray:
    """An infinitesimal rotation of x (n, dim)."""
    W = np.array([[0.0, -0.7, 0.4], [0.7, 0.0, -1.1], [-0.4, 1.1, 0.0]])[: x.shape[1], : x.shape[1]]
    return x @ W.T


def tiles(grid: Grid, rng, material=SOIL) -> MaterialPoints:
    """Points whose support domains have random sizes, straddle cells, and tile the whole grid."""
    lines = []
    for d in range(grid.dim):
        low, high = grid.lower_corner[d], grid.upper_corner[d]
        h = np.diff(np.unique(grid.space.tabulate_dof_coordinates()[:, d].round(12))).min()
        width = rng.uniform(0.3, 0.9, 40) * h
        cuts = low + np.cumsum(width)
        lines.append(np.concatenate(([low], cuts[cuts < high - 0.1 * h], [high])))
    centre = np.stack(
        np.meshgrid(*[(a[1:] + a[:-1]) / 2 for a in lines], indexing="ij"), -1
    ).reshape(-1, grid.dim)
    half = np.stack(np.meshgrid(*[np.diff(a) / 2 for a in lines], indexing="ij"), -1).reshape(
        -1, grid.dim
    )
    return MaterialPoints(material, centre, half, (2 * half).prod(axis=1))
