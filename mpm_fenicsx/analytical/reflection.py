"""What the boundary of a grid sends back of a plane wave: exact for the discrete system.

Square bilinear cells of side h fill x < 0, with full quadrature and the consistent mass; the
boundary is at x = 0 and beyond.  The trapezoidal rule puts p = (2/Δt)(z − 1)/(z + 1) in the place
of d/dt, where z is a step's factor: p = iΩ, Ω = (2/Δt) tan(ωΔt/2).  A wave on the grid is given by
its wave vector, which fixes Ω, so that Δt changes its frequency ω and nothing that comes back.

All is made dimensionless: lengths over h, speeds over c_s, stresses over μ, rates over c_s/h.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eig

_STIFFNESS = np.array([[1.0, -1.0], [-1.0, 1.0]])
_MASS = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6
_MASS_AT_MIDPOINT = np.ones((2, 2)) / 4
_SLOPE = np.array([[-1.0, 1.0], [-1.0, 1.0]]) / 2
"""∫N_a ∂N_b dx of a cell of length 1, by either rule."""


@dataclass(frozen=True)
class _Ground:
    """The dimensionless soil: c_s = ρ = μ = 1, ``fast`` = c_p/c_s; ``rate`` = c_s/h, 1/s."""

    fast: float
    rate: float

    def column(self, p: complex, along: float, stretch: complex, midpoint: bool) -> np.ndarray:
        """Dynamic stiffness (4, 4) of a column of cells whose nodes move as exp(i ``along`` y/h).

        Rows: x, y of the left nodes, x, y of the right ones.  ``stretch`` s of the direction x:
        A_11/s on ∂_x∂_x, s A_22 on ∂_y∂_y, s p² on the mass.
        """
        λ = self.fast**2 - 2
        A11, A22 = np.diag([λ + 2, 1.0]), np.diag([1.0, λ + 2])
        A12 = np.array([[0.0, λ], [1.0, 0.0]])  # of ∂_x w and ∂_y u
        mass_y, stiffness_y = (2 + np.cos(along)) / 3, 2 - 2 * np.cos(along)
        slope_y = 1j * np.sin(along)  # ∫N ∂_y u
        mass_x = stretch * (_MASS_AT_MIDPOINT if midpoint else _MASS)
        mixed = np.kron(_SLOPE.T, A12) - np.kron(_SLOPE, A12.T)
        return (
            np.kron(_STIFFNESS / stretch, A11) * mass_y
            + np.kron(mass_x, A22) * stiffness_y
            + mixed * slope_y
            + p**2 * np.kron(mass_x, np.eye(2)) * mass_y
        )


@dataclass(frozen=True)
class LayerCells:
    """Layers of cells stretched across the boundary, the nodes of the last one's end fixed.

    ``cells``: (κ, β) of each from inside out, s = κ + β/p, β in 1/s.  ``midpoint``: one point
    across, at which a cell of any length keeps the half-space's impedance (Guddati & Lim 2006),
    or full quadrature.  No cells at all are a fixed end.
    """

    cells: tuple[tuple[float, float], ...] = ()
    midpoint: bool = True

    def impedance(self, ground: _Ground, p: complex, along: float) -> np.ndarray | None:
        """Force over displacement (2, 2) at the nodes of x = 0; None where they are fixed."""
        far = None
        for κ, β in reversed(self.cells):
            S = ground.column(p, along, κ + β / ground.rate / p, self.midpoint)
            near = S[:2, :2]
            if far is not None:
                near = near - S[:2, 2:] @ np.linalg.solve(S[2:, 2:] + far, S[2:, :2])
            far = near
        return far


@dataclass(frozen=True)
class Dashpots:
    """Tractions −ρc_p v across and −ρc_s v along the boundary (Lysmer & Kuhlemeyer 1969), by the
    shape functions; times ``normal`` and ``tangential``."""

    normal: float = 1.0
    tangential: float = 1.0

    def impedance(self, ground: _Ground, p: complex, along: float) -> np.ndarray:
        """Force over displacement (2, 2) at the nodes of x = 0."""
        Z = np.diag([self.normal * ground.fast, self.tangential])
        return p * Z * (2 + np.cos(along)) / 3


def reflected_energy(
    material,
    wave: str,
    angle: float,
    cells_per_wavelength: float,
    boundary: LayerCells | Dashpots,
    size: float = 1.0,
) -> float:
    """Energy flux that ``boundary`` sends back, as P and as S wave, over that of a plane wave.

    ``material`` has ``p_speed`` and ``s_speed`` (m/s); ``wave`` is P or S, in the plane; ``angle``
    (rad), from the normal, of the wave vector, whose length is 2π/(``cells_per_wavelength`` h);
    ``size`` h (m).  Round-off is some 1e-15, below which nothing can be told.

    Raises ``ValueError`` for a wave that is neither, an angle outside [0, π/2) and fewer than 4
    cells a wavelength.  The angle is the wave vector's; energy goes up to a few degrees beside it
    where a wave has few cells.
    """
    if wave not in ("P", "S"):
        raise ValueError(f"wave must be P or S, got {wave!r}")
    if not 0 <= angle < np.pi / 2:
        raise ValueError(f"angle must lie in [0, π/2), in rad from the normal, got {angle}")
    if not cells_per_wavelength >= 4:
        raise ValueError(f"cells_per_wavelength must be at least 4, got {cells_per_wavelength}")
    ground = _Ground(material.p_speed / material.s_speed, material.s_speed / size)
    k = 2 * np.pi / cells_per_wavelength
    across, along = k * np.cos(angle), k * np.sin(angle)
    p = 1j * _rate(ground, wave, across, along)
    S = ground.column(p, along, 1.0, midpoint=False)
    factors, shapes = _waves(S)
    flux = np.array([_flux(S, p, ζ, φ) for ζ, φ in zip(factors, shapes, strict=True)])
    free = abs(abs(factors) - 1) < 1e-8  # those that travel; the others carry no energy
    incoming = np.argmin(abs(factors - np.exp(-1j * across)))
    back = np.flatnonzero(np.where(free, flux < 0, abs(factors) > 1))
    Z = boundary.impedance(ground, p, along)

    def unbalanced(ζ: complex, φ: np.ndarray) -> np.ndarray:
        return φ if Z is None else S[2:, :2] @ φ / ζ + (S[2:, 2:] + Z) @ φ

    returned = np.linalg.solve(
        np.stack([unbalanced(factors[j], shapes[j]) for j in back], axis=1),
        -unbalanced(factors[incoming], shapes[incoming]),
    )
    sent = abs(returned) ** 2 * -flux[back] * free[back]
    return float(sent.sum() / flux[incoming])


def _rate(ground: _Ground, wave: str, across: float, along: float) -> float:
    """Ω h/c_s of the wave vector (``across``, ``along``)/h: K φ = Ω² M φ of a node of the grid."""

    def node(p: float) -> np.ndarray:
        S = ground.column(p, along, 1.0, midpoint=False)
        ζ = np.exp(-1j * across)
        return S[2:, :2] / ζ + S[:2, :2] + S[2:, 2:] + S[:2, 2:] * ζ

    K = node(0.0)
    M = (node(1.0) - K)[0, 0].real  # the same in x and y
    slow, fast = np.sqrt(np.linalg.eigvalsh(K / M))
    return float(fast if wave == "P" else slow)


def _waves(S: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Factors ζ (4,) from a node to the next and shapes (4, 2) of what a row of columns ``S`` can
    bear: (S_10 + ζ (S_00 + S_11) + ζ² S_01) φ = 0."""
    none, one = np.zeros((2, 2)), np.eye(2)
    factors, shapes = eig(
        np.block([[none, one], [-S[2:, :2], -(S[:2, :2] + S[2:, 2:])]]),
        np.block([[one, none], [none, S[:2, 2:]]]),
    )
    shapes = shapes[:2] / np.linalg.norm(shapes[:2], axis=0)
    return factors, shapes.T


def _flux(S: np.ndarray, p: complex, ζ: complex, φ: np.ndarray) -> float:
    """Power that the wave φ ζⁿ takes from column −1 to the nodes of x = 0, those behind it."""
    force = -(S[2:, :2] @ φ / ζ + S[2:, 2:] @ φ)
    return float(np.real(np.conj(p * φ) @ force))
