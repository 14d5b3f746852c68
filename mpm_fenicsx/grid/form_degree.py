"""Of which degree a form is in one of its coefficients, and what multiplies it, as it is written
down.

UFL would tell by a derivative, but in 2025 it keeps every form that it has differentiated for ever,
and with it the mesh and its communicator, of which a process has some two thousand.
"""

from __future__ import annotations

import math

from dolfinx import fem
from ufl.corealg.traversal import unique_pre_traversal

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
