"""Every weak form: coefficients and a test function in, integrand out.

A field projected from material points and a constant of a finite element run are the same thing here.
"""

from __future__ import annotations

from ufl import Identity, grad, inner, outer, sym, tr


def strain(u):
    """Small strain ε(u)."""
    return sym(grad(u))


def hooke(λ, μ, ε):
    """Isotropic elastic stress."""
    return λ * tr(ε) * Identity(ε.ufl_shape[0]) + 2 * μ * ε


def inertia(density, acceleration, w):
    """Virtual work of inertia, eq. (6)."""
    return inner(density * acceleration, w)


def internal_work(stress, w):
    """Virtual work of stress."""
    return inner(stress, strain(w))


def along_and_across(n, along, across):
    """Tensor with eigenvalue ``along`` the unit normal n and ``across`` it: T of eqs. (13)-(16)."""
    return across * Identity(len(n)) + (along - across) * outer(n, n)


def dashpot(impedance, velocity, w):
    """Virtual work of a boundary dashpot, eq. (9); impedance a tensor (Pa s/m)."""
    return inner(impedance * velocity, w)


def spring(stiffness, u, stored, w):
    """Virtual work of a boundary spring, eq. (15): stiffness a tensor (Pa/m), ``stored`` the traction (Pa) that it
    bore before the increment u."""
    return inner(stiffness * u + stored, w)


def load(force, w):
    """Virtual work of a force per area (Pa) or per volume (N/m³)."""
    return inner(force, w)
