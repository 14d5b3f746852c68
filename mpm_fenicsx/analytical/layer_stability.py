"""Whether a body and its absorbing layers grow: eigenvalues of small ones, in 2D and 3D.

Stretches s_j = κ_j + β_j/p of the directions j make of the weak form of elastodynamics

    Σ_jl ∫ (J/(s_j s_l)) A_jl ∂_l U · ∂_j w + ∫ ρ p² J U · w = 0,  J = ∏ s_j,  (A_jl)_ik = C_ijkl,

cell by cell, with the midpoint rule across directions in which a cell is stretched.  Motions are
exp(p t); the trapezoidal rule maps the half-plane Re p <= 0 exactly onto the disc of the steps'
factors z, so that no step grows where no p has a positive real part.  Each stretch is a power of p:
κ or β/p, never both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache, reduce

import numpy as np
from scipy.linalg import eigvals
from scipy.sparse import bmat, coo_matrix, csr_matrix, eye

SIDES = ("left", "right", "bottom", "top", "front", "back")
"""Ends of the directions; in 3D the last pair bounds the third."""
WALLS = ("fixed", "roller", "shear")
"""All components held, the one across, those along."""
_UNIT = (0.0, 0.0)


def growth(
    material,
    body: Sequence[int],
    layers: Mapping[str, Sequence[tuple[float, float]]],
    walls: Mapping[str, str] | None = None,
    size: float | Sequence[float] = 1.0,
) -> float:
    """Largest real part of the eigenvalues p, in units of c_s/h; of some 2,000 states at most.

    ``body``: cells in each direction, of ``size`` h (m), one for all or one a direction.
    ``layers``: side (of ``SIDES``) -> (κ, β) of its cells from inside out, β in 1/s, fixed beyond;
    they meet at corners.  ``walls``: side -> one of ``WALLS``, which holds the layers' ends there
    too; a side in neither is free.  ``material`` has ``density``, ``p_speed`` and ``s_speed``, or
    is one for each row of cells of the body, upwards, which go on in the layers; the lowest c_s
    and h are the units.

    Round-off is some 1e-12.  Moduli of p below 1e-4 are not counted: p = 0 is rest, at any place
    where nothing holds the body, and the integral of such a displacement grows and does nothing.

    Raises ``ValueError`` naming a side or a wall that is none, a side with both, and a cell with
    both κ and β.
    """
    E, A = system(material, body, layers, walls, size)
    τ = 0.5  # of the trapezoidal rule, whose step has these eigenvalues z
    step = np.linalg.solve((E - τ * A).toarray(), (E + τ * A).toarray())
    z = eigvals(step, overwrite_a=True, check_finite=False)
    z = z[abs(z + 1) > 1e-3]  # at −1: nodes without mass, within layers that meet
    p = (z - 1) / (τ * (z + 1))
    return float(p[abs(p) > 1e-4].real.max(initial=-np.inf))


def system(
    material,
    body: Sequence[int],
    layers: Mapping[str, Sequence[tuple[float, float]]],
    walls: Mapping[str, str] | None = None,
    size: float | Sequence[float] = 1.0,
) -> tuple[csr_matrix, csr_matrix]:
    """E and A (states, states) of E dx/dt = A x in units of h and c_s; arguments of ``growth``.

    States: v, u, and its repeated integrals where stretches ask for them, of the free nodes.
    """
    dim, walls = len(body), dict(walls or {})
    _check(dim, layers, walls)
    sizes = np.broadcast_to(np.asarray(size, float), dim)
    soils = list(material) if isinstance(material, Sequence) else [material] * body[1]
    rate = min(soil.s_speed for soil in soils) / sizes.min()
    stretches = [
        [
            *reversed(layers.get(SIDES[2 * d], ())),
            *[_UNIT] * body[d],
            *layers.get(SIDES[2 * d + 1], ()),
        ]
        for d in range(dim)
    ]
    below = len(layers.get("bottom", ()))
    shape = [len(line) for line in stretches]
    parts = {}
    for cell in np.ndindex(*shape):
        soil = soils[min(max(cell[1] - below, 0), body[1] - 1)]
        across = tuple(
            stretches[d][i] if not _in_body(i, d, body, layers) else None
            for d, i in enumerate(cell)
        )
        moduli = _moduli(soil, min(soils, key=lambda s: s.s_speed))
        terms = _cell(across, moduli, tuple(sizes / sizes.min()), rate)
        dofs = _dofs(cell, shape)
        for power, matrix in terms:
            parts.setdefault(power, []).append((dofs, matrix))
    count = dim * int(np.prod(np.array(shape) + 1))
    free = np.setdiff1d(np.arange(count), _held(shape, layers, walls))
    S = {power: _assemble(some, count)[free][:, free] for power, some in parts.items()}
    return _first_order(S, len(free))


def _check(dim: int, layers: Mapping, walls: Mapping) -> None:
    for side in (*layers, *walls):
        if side not in SIDES[: 2 * dim]:
            raise ValueError(f"side must be one of {', '.join(SIDES[: 2 * dim])}, got {side!r}")
    for side, kind in walls.items():
        if kind not in WALLS:
            raise ValueError(f"wall must be one of {', '.join(WALLS)}, got {kind!r}")
        if side in layers:
            raise ValueError(f"side {side} must have a layer or a wall, got both")
    for κ, β in (cell for cells in layers.values() for cell in cells):
        if (κ > 0) == (β > 0):
            raise ValueError(f"a cell must have either κ or β above 0, got {κ} and {β}")


def _in_body(i: int, d: int, body: Sequence[int], layers: Mapping) -> bool:
    return 0 <= i - len(layers.get(SIDES[2 * d], ())) < body[d]


def _moduli(soil, unit) -> tuple[float, float, float]:
    """λ, μ and ρ over μ and ρ of ``unit``."""
    density = soil.density / unit.density
    μ = density * (soil.s_speed / unit.s_speed) ** 2
    return density * (soil.p_speed / unit.s_speed) ** 2 - 2 * μ, μ, density


@lru_cache(maxsize=4096)
def _cell(across: tuple, moduli: tuple, sizes: tuple, rate: float) -> list:
    """Pairs of n and the matrix of pⁿ of one cell; ``across``: its (κ, β) or None, a direction."""
    dim, (λ, μ, density) = len(across), moduli
    amounts = [1.0 if s is None else s[0] or s[1] / rate for s in across]
    falls = [int(s is not None and s[0] == 0) for s in across]  # powers of 1/p
    mass, slope, stiff = [], [], []
    for s, h in zip(across, sizes, strict=True):
        mass.append(h * (np.array([[2, 1], [1, 2]]) / 6 if s is None else np.full((2, 2), 0.25)))
        slope.append(np.array([[-1, 1], [-1, 1]]) / 2)  # ∫N_a ∂N_b
        stiff.append(np.array([[1, -1], [-1, 1]]) / h)
    δ, J, fall = np.eye(dim), float(np.prod(amounts)), sum(falls)
    terms: dict[int, np.ndarray] = {2 - fall: density * J * _product(mass, np.eye(dim))}
    for j in range(dim):
        for m in range(dim):
            A = λ * np.outer(δ[j], δ[m]) + μ * (δ[j, m] * δ + np.outer(δ[m], δ[j]))
            lines = list(mass)
            if j == m:
                lines[j] = stiff[j]
            else:
                lines[j], lines[m] = slope[j].T, slope[m]
            power = falls[j] + falls[m] - fall
            part = J / (amounts[j] * amounts[m]) * _product(lines, A)
            terms[power] = terms.get(power, 0) + part
    return list(terms.items())


def _product(lines: list, components: np.ndarray) -> np.ndarray:
    """Of matrices (2, 2) a direction, the last one's nodes outermost, components within a node."""
    return np.kron(reduce(np.kron, reversed(lines)), components)


def _dofs(cell: tuple, shape: Sequence[int]) -> np.ndarray:
    """Of the cell's nodes, the first direction fastest."""
    nodes = np.array([0])
    stride = 1
    for i, n in zip(cell, shape, strict=True):
        nodes = np.concatenate([nodes + i * stride, nodes + (i + 1) * stride])
        stride *= n + 1
    return (len(cell) * nodes[:, None] + np.arange(len(cell))).ravel()


def _held(shape: Sequence[int], layers: Mapping, walls: Mapping) -> np.ndarray:
    """Components of nodes at walls, and all at the layers' ends."""
    dim = len(shape)
    index = np.arange(np.prod(np.array(shape) + 1)).reshape([n + 1 for n in shape][::-1])
    held = []
    for side in (*layers, *walls):
        d, end = divmod(SIDES.index(side), 2)
        nodes = np.take(index, -end, axis=dim - 1 - d).ravel()
        kind = walls.get(side, "fixed")
        held += [
            dim * nodes + i for i in range(dim) if kind == "fixed" or (i == d) == (kind == "roller")
        ]
    return np.concatenate(held) if held else np.zeros(0, int)


def _assemble(some: list, count: int) -> csr_matrix:
    rows = np.concatenate([np.repeat(dofs, len(dofs)) for dofs, _ in some])
    columns = np.concatenate([np.tile(dofs, len(dofs)) for dofs, _ in some])
    values = np.concatenate([matrix.ravel() for _, matrix in some])
    return coo_matrix((values, (rows, columns)), shape=(count, count)).tocsr()


def _first_order(S: dict, free: int) -> tuple[csr_matrix, csr_matrix]:
    """Σ pⁿ S_n u = 0 by the states v, u, ∫u dt, ∬u dt …, where a matrix asks for them."""
    nothing, one = csr_matrix((free, free)), eye(free, format="csr")
    on = [np.arange(free)]  # which components have an integral
    for power in range(-1, min(S) - 1, -1):
        asked = [np.flatnonzero(abs(S[n]).sum(axis=0)) for n in S if n <= power]
        on.append(np.unique(np.concatenate(asked)))
    pick = [one[rows] for rows in on]
    blocks_E = [[S.get(2, nothing), *[None] * len(on)]]
    blocks_A = [[-S.get(1, nothing)] + [-S.get(-n, nothing) @ P.T for n, P in enumerate(pick)]]
    previous = one
    for n, P in enumerate(pick):
        E, A = [None] * (len(on) + 1), [None] * (len(on) + 1)
        E[n + 1] = eye(len(on[n]), format="csr")
        A[n] = P @ previous.T
        previous = P
        blocks_E.append(E)
        blocks_A.append(A)
    return bmat(blocks_E, format="csr"), bmat(blocks_A, format="csr")
