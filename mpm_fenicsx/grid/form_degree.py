"""Of which degree a form is in one of its coefficients, as it is written down.

UFL would tell by a derivative, but in 2025 it keeps every form that it has differentiated for ever,
and with it the mesh and its communicator, of which a process has some two thousand.
"""

from __future__ import annotations

import math

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
