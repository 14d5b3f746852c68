"""Grids, points and support domains of any kind for hypothesis, and the same seen from other
frames.

Grids are rectilinear with lines at multiples of 2⁻⁵ m; points lie anywhere in them, on lines,
nodes, edges and corners too, and support domains are of any size.
"""

from __future__ import annotations

import gc
from itertools import count

import numpy as np
from hypothesis import strategies as st

from mpm_fenicsx import Grid, LinearElastic, MaterialPoints
from mpm_fenicsx.common import tensors

SOIL = LinearElastic(young=20e6, poisson=0.25, density=1500.0)
MADE = count(1)


@st.composite
def lines_of(draw, dim):
    """Grid lines of each direction: one cell or several, the widest five times the narrowest."""
    width = st.lists(st.integers(8, 40), min_size=1, max_size=6 - dim)
    first = st.integers(-100, 100)
    return [(draw(first) + np.cumsum([0, *draw(width)])) / 32.0 for _ in range(dim)]


def grid_of(lines):
    """A grid on these lines.  MPICH aborts without a word once some 300 are alive, which tests that
    fail hold on to."""
    if next(MADE) % 100 == 0:
        gc.collect()
    return Grid.rectilinear(lines)


@st.composite
def strewn(draw, lines, least=0.0):
    """Points x (n, dim) on lines or between, and half support domains (n, dim), m, to far beyond
    half a cell."""
    place = [st.one_of(st.sampled_from(list(line)), st.floats(line[0], line[-1])) for line in lines]
    size = st.one_of(st.just(least), st.floats(least, 0.3), st.floats(least, 6.0))
    n = draw(st.integers(1, 6))
    x = [draw(st.tuples(*place)) for _ in range(n)]
    half = [draw(st.tuples(*[size] * len(lines))) for _ in range(n)]
    return np.array(x), np.array(half)


def domains(lines, x, half):
    """Ends [a, b] of the support domains: no wider than the point's cell, on a line the one above,
    and cut off at the ends of the cells beside it, or of the grid."""
    a, b = np.empty_like(x), np.empty_like(x)
    for d, line in enumerate(lines):
        c = np.clip(np.searchsorted(line, x[:, d], side="right") - 1, 0, len(line) - 2)
        l = np.minimum(half[:, d], (line[c + 1] - line[c]) / 2)
        a[:, d] = np.maximum(x[:, d] - l, line[np.maximum(c - 1, 0)])
        b[:, d] = np.minimum(x[:, d] + l, line[np.minimum(c + 2, len(line) - 1)])
    return a, b


def size_of(lines):
    """Largest coordinate and narrowest cell."""
    return max(np.abs(line).max() for line in lines), min(np.diff(line).min() for line in lines)


def strewn_body(draw, lines, rng):
    """Such points with mass, stress and velocity at random."""
    x, half = draw(strewn(lines, least=1e-6))
    body = MaterialPoints(SOIL, x, half, rng.uniform(0.5, 2.0, len(x)))
    body.stress[:] = 1e5 * rng.normal(size=body.stress.shape)
    body.velocity, body.acceleration = rng.normal(size=(2, *x.shape))
    return body


def scene(dim, law, rng, on_lines):
    """Grid lines, a body and gravity at random: cells with 2^dim points, some with a few more, and
    empty ones.

    Points keep off the lines by 2 % of a cell, as the cell above a line is another one in a mirror;
    if ``on_lines``, some are on them and all coordinates are multiples of 2⁻²⁰ m, which a
    translation by multiples of 2⁻⁵ does not round.  A cell with few points would leave the matrix
    singular.
    """
    lines = [
        (rng.integers(-100, 100) + np.cumsum([0, *rng.integers(8, 41, rng.integers(1, 6 - dim))]))
        / 32.0
        for _ in range(dim)
    ]
    grid = grid_of(lines)
    low, h = grid.lattice.lower, grid.lattice.upper - grid.lattice.lower
    full = np.union1d(np.flatnonzero(rng.random(grid.cells) < 0.6), rng.integers(grid.cells))
    even = np.stack(np.meshgrid(*[[0.25, 0.75]] * dim), -1).reshape(-1, dim)
    place = even + rng.uniform(-0.08, 0.08, (len(full), *even.shape))
    more = rng.choice(full, 6)
    share = rng.uniform(0.02, 0.98, (6, dim))
    if on_lines:
        share = np.where(rng.random(share.shape) < 0.4, rng.integers(2, size=share.shape), share)
    x = np.vstack(
        ((low[full, None] + place * h[full, None]).reshape(-1, dim), low[more] + share * h[more])
    )
    half = np.vstack(
        (np.repeat(h[full] / 4, len(even), axis=0), h[more] * rng.uniform(0.01, 1.0, share.shape))
    )
    keep = np.isin(grid.find(x), full)
    x, half = np.round(x[keep] * 2**20) / 2**20, np.ceil(half[keep] * 2**20) / 2**20
    body = MaterialPoints(law, x, half, (2 * half).prod(axis=1))
    body.stress[:] = 1e5 * rng.normal(size=body.stress.shape)
    body.velocity, body.acceleration = rng.normal(size=x.shape), 100.0 * rng.normal(size=x.shape)
    return lines, body, 100.0 * rng.normal(size=dim)


# -- other frames ----------------------------------------------------------------------------------


def full(stress):
    """Stress tensors (n, 3, 3) of rows."""
    if stress.shape[1] == 6:
        return tensors.matrix(stress, 3)
    out = np.zeros((len(stress), 3, 3))
    out[:, :2, :2], out[:, 2, 2] = tensors.matrix(stress, 2), stress[:, 2]
    return out


def turned_stress(stress, Q):
    """Rows of Q σ Qᵀ."""
    R, dim = np.eye(3), len(Q)
    R[:dim, :dim] = Q
    σ = R @ full(stress) @ R.T
    return np.stack(
        [σ[:, i, i] for i in range(3)] + [σ[:, i, j] for i, j in tensors.SHEAR[dim]], axis=1
    )


def in_frame(body, Q, shift=0.0, v=0.0, a=0.0):
    """The body seen from another frame: y = Q x + shift, with a velocity and an acceleration on
    top."""
    return MaterialPoints(
        body.material,
        body.x @ Q.T + shift,
        body.half @ np.abs(Q).T,
        body.volume,
        turned_stress(body.stress, Q),
        body.velocity @ Q.T + v,
        body.acceleration @ Q.T + a,
    )
