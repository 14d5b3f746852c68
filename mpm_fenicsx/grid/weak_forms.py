"""Every weak form: coefficients and a test function in, integrand out.

A field projected from material points and a constant of a finite element run are the same thing
here.
"""

from __future__ import annotations

import numpy as np
from ufl import Identity, as_matrix, as_vector, div, dot, grad, inner, jump, outer, sym, tr

from ..common.tensors import SHEAR, entries


def strain(u):
    """Small strain ε(u)."""
    return sym(grad(u))


def hooke(λ, μ, ε):
    """Isotropic elastic stress."""
    return λ * tr(ε) * Identity(ε.ufl_shape[0]) + 2 * μ * ε


def distortion_work(μ, u, w):
    """Virtual work of the deviatoric elastic stress, that of 3D in plane strain too."""
    ε = strain(u)
    return inner(2 * μ * (ε - tr(ε) / 3 * Identity(ε.ufl_shape[0])), strain(w))


def dilation_work(λ, μ, u, w):
    """Virtual work of the mean elastic stress."""
    return (λ + 2 * μ / 3) * div(u) * div(w)


def elastic_work(λ, μ, u, w, dx, centre=None):
    """Virtual work of the elastic stress of u, integrated; that of volume changes over ``centre``,
    the same cells with one point each, if it is given (B-bar)."""
    if centre is None:
        return internal_work(hooke(λ, μ, strain(u)), w) * dx
    return distortion_work(μ, u, w) * dx + dilation_work(λ, μ, u, w) * centre


def row(ε):
    """In-plane strain as a vector with engineering shear strains, in the order of ``tensors``."""
    dim = ε.ufl_shape[0]
    return as_vector([ε[i, i] for i in range(dim)] + [2 * ε[i, j] for i, j in SHEAR[dim]])


def tensor(row, dim: int):
    """Symmetric tensor of its row of numbers, in the plane (xx, yy, xy), in 3D all six."""
    at = {pair: dim + k for k, pair in enumerate(SHEAR[dim])} | {(i, i): i for i in range(dim)}
    return as_matrix([[row[at[(min(i, j), max(i, j))]] for j in range(dim)] for i in range(dim)])


def square(numbers, size: int):
    """Matrix (size, size) of its entries row by row or, where there are fewer, symmetric of its
    upper triangle."""
    whole = len(numbers) == size**2
    at = {pair: k for k, pair in enumerate(zip(*entries(size, not whole), strict=True))}
    return as_matrix(
        [
            [numbers[at[(i, j) if whole else (min(i, j), max(i, j))]] for j in range(size)]
            for i in range(size)
        ]
    )


def plastic_work(stress, w):
    """Virtual work of ``stress`` given as a row of numbers (Pa)."""
    return inner(stress, row(strain(w)))


def plastic_stiffness(tangent, u, w):
    """Its derivative, ``tangent`` the entries of ∂σ/∂ε, Pa (see ``square``)."""
    ε, virtual = row(strain(u)), row(strain(w))
    return inner(square(tangent, len(ε)) * ε, virtual)


def flat(tensor):
    """Components of a tensor, row by row, as a vector."""
    return as_vector([tensor[index] for index in np.ndindex(tensor.ufl_shape)])


def nominal_work(stress, w):
    """Virtual work of the first Piola-Kirchhoff stress given as a row of numbers (Pa)."""
    return inner(stress, flat(grad(w)))


def nominal_stiffness(tangent, u, w):
    """Its derivative, ``tangent`` the entries of ∂P/∂F, Pa (see ``square``)."""
    gradient, virtual = flat(grad(u)), flat(grad(w))
    return inner(square(tangent, len(gradient)) * gradient, virtual)


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
    """Virtual work of a boundary spring, eq. (15): stiffness a tensor (Pa/m), ``stored`` the
    traction (Pa) that it bore before the increment u."""
    return inner(stiffness * u + stored, w)


def load(force, w):
    """Virtual work of a force per area (Pa) or per volume (N/m³)."""
    return inner(force, w)


def averaging(volume, squared, value, w):
    """Weak form of q - l² ∇²q where a ``volume`` (-) of material is, l² being ``squared`` (m²)."""
    return volume * (value * w + squared * inner(grad(value), grad(w)))


def across(J, n):
    """Size of a cell of a rectilinear grid across its facet of normal n, J its Jacobian."""
    return sum(abs(dot(n, J[:, k])) for k in range(len(n)))


def kink(weight, u, w, n):
    """Virtual work against a jump of ∂u/∂n between two cells, of a ``weight`` (Pa m)."""
    return weight * inner(jump(grad(u), n), jump(grad(w), n))
