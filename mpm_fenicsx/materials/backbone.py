"""Backbones: how shear stress grows with shear strain under a first loading, and what they damp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.checks import array, increasing, positive

FINE = 400
"""Places a decade at which a damping ratio without closed form is integrated."""


class Backbone:
    """Shear stress τ = G γ R(γ) with the reduction R = G_secant/G, which falls from 1.

    γ (-) is the engineering shear strain in simple shear.  A backbone of your own states
    ``reduction`` and ``range``.
    """

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest strain that elements need to tell apart."""
        raise NotImplementedError(f"{type(self).__name__} needs range")

    def reduction(self, strain) -> np.ndarray:
        """R = G_secant/G (n,) at strains γ (n,)."""
        raise NotImplementedError(f"{type(self).__name__} needs reduction")

    def damping_ratio(self, strain) -> np.ndarray:
        """ξ (n,), of 1, in cycles between −γ and γ (n,) by Masing's rules.

        ξ = ΔW/4πW with the loop's area ΔW = 8 ∫τ dγ − 4τγ and W = τγ/2: (2/π) (2 ∫τ dγ/τγ − 1).
        """
        γ = np.atleast_1d(np.asarray(strain, float))
        low = min(1e-3 * self.range[0], γ.min())
        places = max(2, int(FINE * np.log10(γ.max() / low)) + 2)
        x = np.unique(np.concatenate((np.geomspace(low, γ.max(), places), γ)))
        τ = x * self.reduction(x)
        area = 0.5 * τ[0] * x[0] + np.append(0.0, np.cumsum(0.5 * (τ[1:] + τ[:-1]) * np.diff(x)))
        at = np.searchsorted(x, γ)
        ξ = 2.0 / np.pi * (2.0 * area[at] / (τ[at] * γ) - 1.0)
        return np.maximum(ξ, 0.0).reshape(np.shape(strain))


@dataclass(frozen=True)
class Hyperbolic(Backbone):
    """R = 1/(1 + γ/γ_r), with the ``reference_strain`` γ_r (-) at which R = ½ (Hardin & Drnevich
    1972).

    The shear stress tends to G γ_r.  Raises ``ValueError`` naming what is not positive.
    """

    reference_strain: float

    def __post_init__(self) -> None:
        strain = positive("reference_strain", self.reference_strain)
        object.__setattr__(self, "reference_strain", strain)

    @property
    def range(self) -> tuple[float, float]:
        """From 0.03 to 30 times the reference strain."""
        return 0.03 * self.reference_strain, 30.0 * self.reference_strain

    def reduction(self, strain) -> np.ndarray:
        """R (n,) at strains γ (n,)."""
        return 1.0 / (1.0 + np.abs(np.asarray(strain, float)) / self.reference_strain)

    def damping_ratio(self, strain) -> np.ndarray:
        """ξ (n,), of 1: (2/π) [2 (1 + x) (x − ln(1 + x))/x² − 1] with x = γ/γ_r."""
        x = np.abs(np.asarray(strain, float)) / self.reference_strain
        small = x < 1e-3  # where x − ln(1 + x) has lost its digits
        y = np.where(small, 1.0, x)
        closed = 2.0 * (1.0 + y) * (y - np.log1p(y)) / y**2 - 1.0
        return 2.0 / np.pi * np.where(small, x / 3.0 - x**2 / 6.0, closed)


@dataclass(frozen=True)
class ReductionCurve(Backbone):
    """Measured ``ratio`` R = G/G_max (-) at shear ``strain`` γ (-, not percent), both sequences.

    Between two points R = 1/(1 + (γ/b)^a) with the b and a that meet both, as measured curves do
    nearly everywhere; below the first with R < 1 the same with a = 1, and beyond the last the shear
    stress stays what it is.  Points with R = 1 say no more.  Raises ``ValueError`` where strains do
    not increase from above 0, ratios do not fall from at most 1 to above 0, or where the stress
    G γ R would fall.
    """

    strain: tuple[float, ...]
    ratio: tuple[float, ...]

    def __post_init__(self) -> None:
        strain, ratio = increasing("strain", self.strain), array("ratio", self.ratio)
        if ratio.shape != strain.shape:
            raise ValueError(f"ratio must be {len(strain)} numbers, as strain is, got {self.ratio}")
        positive("strain", strain[0])
        falling = ratio[0] <= 1.0 and 0.0 < ratio[-1] < 1.0 and (np.diff(ratio) <= 0.0).all()
        if not falling:
            raise ValueError(
                f"ratio must fall from at most 1 to more than 0, and never rise, got {self.ratio}"
            )
        stress = strain * ratio
        falls = np.flatnonzero(np.diff(stress) < 0.0)
        if len(falls):
            k = falls[0]
            raise ValueError(
                f"ratio must not fall so fast that the stress does, got {ratio[k]} at "
                f"{strain[k]} and {ratio[k + 1]} at {strain[k + 1]}"
            )
        object.__setattr__(self, "strain", tuple(strain.tolist()))
        object.__setattr__(self, "ratio", tuple(ratio.tolist()))

    @property
    def range(self) -> tuple[float, float]:
        """The first and the last strain."""
        return self.strain[0], self.strain[-1]

    def reduction(self, strain) -> np.ndarray:
        """R (n,) at strains γ (n,)."""
        γ, last = np.abs(np.asarray(strain, float)), self.strain[-1]
        below = np.array(self.ratio) < 1.0
        x, y = np.log(self.strain)[below], np.log(1.0 / np.array(self.ratio)[below] - 1.0)
        at = np.log(np.clip(γ, np.finfo(float).tiny, last))
        flatter = np.interp(at, x, y) + np.minimum(at - x[0], 0.0)
        return last / np.maximum(γ, last) / (1.0 + np.exp(flatter))
