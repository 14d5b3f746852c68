"""A law of your own
=================

Drucker and Prager's soil, with a flow rule that is not associated.

A law inherits from ``Law``, states its density and elastic constants, names what it remembers and
answers ``tangent`` for many points at once.  This one is ``OnElastic``, a ``Law`` that has the
constants from an elastic soil, and is of finite strain where that is a ``Hencky``.  Its tangent is
not symmetric; it says so, is carried whole, and the run takes a solver that suits.

Run it by::

    python demos/extensions/drucker_prager.py
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mpm_fenicsx import LinearElastic, OnElastic, hooke, stiffness


@dataclass(frozen=True)
class DruckerPrager(OnElastic):
    """Yields at q + μ p = k, and flows by Δεᵖ = Δγ ∂(q + ψ p)/∂σ; p is the mean stress, tension
    positive, and q = √(3 J₂).

    ``elastic``: its stiffness and density; ``friction`` μ (-), ``dilation`` ψ (-), ``cohesion`` k
    (Pa).  Backward Euler, with h = 3 G + K μ ψ and the trial state as if elastic:

        Δγ = (q_trial + μ p_trial - k) / h,   q = q_trial - 3 G Δγ,   p = p_trial - K ψ Δγ

    and where q would be negative the apex, p = k/μ.
    """

    elastic: LinearElastic
    friction: float
    dilation: float
    cohesion: float

    history = ("plastic_work",)
    symmetric = False

    def tangent(self, strain, stress, history, given=None):
        """Stress, plastic work and ∂σ/∂ε after the increments."""
        λ, G = self.lame
        K, μ, ψ, k = λ + 2 * G / 3, self.friction, self.dilation, self.cohesion
        trial, dim = hooke(self.lame, strain, stress), 2 if strain.shape[1] == 4 else 3
        one = np.zeros(strain.shape[1])
        one[:3] = 1.0
        p = trial[:, :3].mean(axis=1)
        s = trial - p[:, None] * one
        weight = 1.0 + (one == 0.0)  # shear counts twice in s : s
        q = np.sqrt(1.5 * (weight * s**2).sum(axis=1))
        D = np.tile(stiffness(self.lame, dim), (len(strain), 1, 1))
        new, work = trial.copy(), history.copy()
        rows = np.flatnonzero(q + μ * p > k * (1 + 1e-12))
        if not len(rows):
            return new, work, D
        q, p, s = q[rows], p[rows], s[rows]
        h = 3 * G + K * μ * ψ
        Δγ = (q + μ * p - k) / h
        left = q - 3 * G * Δγ
        apex = left < 0.0
        mean = np.where(apex, k / μ if μ else np.inf, p - K * ψ * Δγ)
        ratio = np.where(apex, 0.0, left / np.where(q > 0.0, q, 1.0))
        new[rows] = mean[:, None] * one + ratio[:, None] * s
        work[rows, 0] += np.where(apex, mean * (p - mean) / K, (left + ψ * mean) * Δγ)
        # derivatives of q_trial and p_trial by strain, and what follows from them
        along = s / np.where(q > 0.0, q, 1.0)[:, None]
        by_q, by_p = 3 * G * along, K * np.broadcast_to(one, s.shape)
        flow = (by_q + μ * by_p) / h
        deviatoric = stiffness((-2 * G / 3, G), dim)
        smooth = (
            ratio[:, None, None] * deviatoric
            + along[:, :, None] * ((1.0 - ratio)[:, None] * by_q - 3 * G * flow)[:, None]
            + one[:, None] * (by_p - K * ψ * flow)[:, None]
        )
        D[rows] = np.where(apex[:, None, None], 0.0, smooth)
        return new, work, D


if __name__ == "__main__":
    soil = LinearElastic(young=20e6, poisson=0.3, density=1800.0)
    law = DruckerPrager(soil, friction=1.2, dilation=0.0, cohesion=10e3)
    stress, history = np.array([[-20e3, -20e3, -20e3, 0.0]]), np.zeros((1, 1))
    stress, history = law.respond(np.array([[0.0, 0.0, 0.0, 0.01]]), stress, history)
    limit = (law.cohesion + 1.2 * 20e3) / np.sqrt(3.0)
    print(f"shear stress {stress[0, 3]:.6g} Pa, exact {limit:.6g} Pa")
