"""Bad input is refused, and the refusal names it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpm_fenicsx.common.checks import array, between, finite, one_of, positive, whole


@settings(max_examples=30, deadline=None)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_finite_number_passes_unchanged(value):
    assert finite("load", value) == value


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("check", [finite, positive, lambda n, v: between(n, v, -1, 1), whole])
def test_what_is_not_finite_is_refused_by_name(check, value):
    with pytest.raises(ValueError, match=f"young must be finite, got {value}"):
        check("young", value)


@pytest.mark.parametrize(
    "value", ["soft", "1", b"1", np.array("1"), np.complex128(1j), None, [1.0, 2.0]]
)
def test_what_is_no_number_is_refused_by_name(value):
    with pytest.raises(ValueError, match="young must be a number"):
        finite("young", value)


@pytest.mark.parametrize("value", [["1", "2"], [1.0, 1j], np.array([1j]), [[1.0], [1.0, 2.0]]])
def test_an_array_of_something_else_is_refused_by_name(value):
    with pytest.raises(ValueError, match="half must be an array of numbers"):
        array("half", value)


@pytest.mark.parametrize("value", [0.0, -0.0, -1e-300])
def test_positive_excludes_zero(value):
    with pytest.raises(ValueError, match="density must be positive"):
        positive("density", value)
    assert positive("density", 5e-324) > 0


def test_between_excludes_both_ends():
    assert between("poisson", math.nextafter(0.5, 0), -1, 0.5) < 0.5
    for end in (-1, 0.5):
        with pytest.raises(
            ValueError, match=r"poisson must lie between -1 and 0\.5, both excluded"
        ):
            between("poisson", end, -1, 0.5)


def test_whole_takes_a_whole_float_and_refuses_the_rest():
    assert whole("steps", 3.0) == 3 and isinstance(whole("steps", 3.0), int)
    for value in (2.5, 0, -1):
        with pytest.raises(ValueError, match="steps must be a whole number of at least 1"):
            whole("steps", value)
    assert whole("level", 0, least=0) == 0


def test_one_of_says_what_is_known_even_of_an_iterator():
    assert one_of("side", "top", iter(("top", "left"))) == "top"
    with pytest.raises(ValueError, match="side must be one of top, left, got 'north'"):
        one_of("side", "north", iter(("top", "left")))
