"""Of which degree a form is in its coefficients, and what multiplies one, as it is written down.

UFL would tell by a derivative, but in 2025 it keeps every form that it has differentiated for ever,
and with it the mesh and its communicator, of which a process has some two thousand.
"""

from __future__ import annotations

import math

from dolfinx import fem
from ufl import Constant
from ufl.algorithms import extract_coefficients
from ufl.corealg.traversal import unique_pre_traversal

from . import dolfinx_versions

KNOWN = {
    *("Argument", "MultiIndex", "IntValue", "FloatValue", "ScalarValue", "RealValue", "Zero"),
    *("Identity", "PermutationSymbol"),
}
"""What is the same in every cell, beside constants."""
PRODUCTS = {"Product", "Inner", "Dot", "Outer", "Cross"}
LINEAR = {
    *("Sum", "Indexed", "IndexSum", "ComponentTensor", "ListTensor", "Variable", "Conj", "Real"),
    *("Grad", "Div", "Curl", "NablaGrad", "NablaDiv", "ReferenceGrad", "ReferenceValue"),
    *("Transposed", "Trace", "Sym", "Skew", "Deviatoric", "Perp"),
    *("PositiveRestricted", "NegativeRestricted", "CellAvg", "FacetAvg"),
}


def degree(form, coefficient) -> float:
    """0 where it does not depend on the coefficient, 1 where it is linear or affine, 2 … for
    products, infinite for what is no polynomial, or is not known to be one."""
    known: dict[object, float] = {}
    return max(_degree(part.integrand(), coefficient, known) for part in form.integrals())


def affine_in_fields(integral, unknown=None) -> bool:
    """Whether an integral over cells, or its derivative by the ``unknown``, is affine in the values
    that all other fields have in a cell, as it is written down, and the same in every cell of one
    shape: places, conditions and functions of fields are not, whatever their values."""
    terms = _degrees(integral.integrand(), unknown, {})
    if terms is None or any(of_unknown > 1 for of_unknown, _ in terms):
        return False
    of_fields = (b for a, b in terms if unknown is None or a == 1)
    spaces = (f.ufl_function_space() for f in extract_coefficients(integral.integrand()))
    return max(of_fields, default=0) <= 1 and all(map(dolfinx_versions.maps_as_it_is, spaces))


def _degrees(expression, unknown, known: dict) -> set[tuple[int, int]] | None:
    """Of each term the degrees in the ``unknown`` and in all other coefficients together; None
    where it is no polynomial of these and constants, or is not known to be one."""
    if expression in known:
        return known[expression]
    kind, operands = type(expression).__name__, expression.ufl_operands
    if expression is unknown:
        found = {(1, 0)}
    elif isinstance(expression, fem.Function):
        found = {(0, 1)}
    elif not operands:
        same = kind in KNOWN or isinstance(expression, (fem.Constant, Constant))
        found = {(0, 0)} if same else None
    else:
        each = [_degrees(operand, unknown, known) for operand in operands]
        if None in each:
            found = None
        elif kind in PRODUCTS:
            found = {(0, 0)}
            for one in each:
                found = {(a + c, b + d) for a, b in found for c, d in one}
        elif kind in LINEAR or (kind == "Division" and each[1] == {(0, 0)}):
            found = set().union(*each[: 1 if kind == "Division" else None])
        else:
            found = None
    known[expression] = found
    return found


def factors(form, coefficient) -> list:
    """Coefficients and constants that multiply ``coefficient`` in a form that is linear in it: what
    its derivative is made of."""
    known: dict[object, float] = {}
    found: dict[object, None] = {}
    for part in form.integrals():
        if _degree(part.integrand(), coefficient, known):
            _collect(part.integrand(), coefficient, known, found)
    return list(found)


def _collect(expression, coefficient, known: dict, found: dict) -> None:
    if expression is coefficient:
        return
    summed = type(expression).__name__ in ("Sum", "ListTensor")
    for operand in expression.ufl_operands:
        if _degree(operand, coefficient, known):
            _collect(operand, coefficient, known, found)
        elif not summed:  # a factor, whatever it is made of
            found.update(
                dict.fromkeys(
                    node
                    for node in unique_pre_traversal(operand)
                    if isinstance(node, (fem.Function, fem.Constant))
                )
            )


def _degree(expression, coefficient, known: dict) -> float:
    if expression in known:
        return known[expression]
    if expression is coefficient:
        found = 1.0
    else:
        each = [_degree(operand, coefficient, known) for operand in expression.ufl_operands]
        kind = type(expression).__name__
        if not any(each):
            found = 0.0
        elif kind in PRODUCTS:
            found = sum(each)
        elif kind in LINEAR or (kind == "Division" and not each[1]):
            found = max(each)
        else:
            found = math.inf
    known[expression] = found
    return found
