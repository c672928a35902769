"""Elementary functions of fixed bits, against numpy's extended precision."""

import re

import numpy as np
import pytest

from crowdsim.core.angles import cos_sin
from crowdsim.core.mathematics import atan2, exp, nearest, whole_below

WIDE = np.finfo(np.longdouble).nmant > 60
"""Whether long doubles have more bits than doubles; else only numpy's own doubles are there to compare with."""


def ulps(found: np.ndarray, exact: np.ndarray) -> float:
    """Return the greatest error in units of the last place of the exact value."""
    step = np.spacing(np.abs(exact.astype(float))).astype(exact.dtype)
    return float(np.max(np.abs(found.astype(exact.dtype) - exact) / step))


def exactly(function, *arguments: np.ndarray) -> np.ndarray:
    return function(*(argument.astype(np.longdouble) for argument in arguments))


def most(bound: float) -> float:
    return bound if WIDE else bound + 1.0


def test_exponentials_are_exact_to_less_than_1_1_ulp():
    rng = np.random.default_rng(0)
    values = np.concatenate([rng.uniform(-745, 709.7, 20000), -40 * rng.random(20000), rng.normal(0, 1e-9, 1000)])
    found = np.array([exp(value) for value in values])
    assert ulps(found, exactly(np.exp, values)) < most(1.1)


@pytest.mark.parametrize(
    "value",
    [
        *(0.0, -0.0, np.inf, -np.inf, np.nan, 709.782712893384, 709.7827128933841, 1e300, -745.1332191019411, -746.0),
        *(-708.3964185322641, 5e-324, -1e300, 1e-300),
    ],
)
@pytest.mark.filterwarnings("ignore:overflow encountered")
def test_edges_of_exponentials_are_those_of_numpy(value):
    np.testing.assert_array_equal(exp(value), np.exp(value))


def test_arc_tangents_are_exact_to_less_than_2_ulp():
    rng = np.random.default_rng(0)
    y, x = rng.normal(0, 1, (2, 60000))
    y[:10000] *= 10.0 ** rng.uniform(-300, 300, 10000)
    x[5000:15000] *= 10.0 ** rng.uniform(-300, 300, 10000)
    y[15000:25000] = x[15000:25000] * (1.0 + rng.normal(0, 1e-9, 10000))
    y[25000:35000] = 0.5 * x[25000:35000] * (1.0 + rng.normal(0, 1e-3, 10000))
    found = np.array([atan2(*point) for point in zip(y, x, strict=True)])
    assert ulps(found, exactly(np.arctan2, y, x)) < most(2.0)


def test_edges_of_arc_tangents_are_those_of_numpy_signs_of_zeros_included():
    edges = [0.0, 1.0, 0.5, 3.0, 5e-324, 2.2e-308, 1e-200, 1.7e308, np.inf]
    edges = [*edges, *(-edge for edge in edges), np.nan]
    for y in edges:
        for x in edges:
            found, expected = atan2(y, x), np.arctan2(y, x)
            np.testing.assert_allclose(found, expected, rtol=4e-16, atol=0, err_msg=f"{y} {x}")
            assert np.isnan(found) or np.signbit(found) == np.signbit(expected)


def test_cosines_and_sines_are_exact_to_less_than_3e_16_near_whole_quarters_too():
    rng = np.random.default_rng(0)
    angles = np.concatenate(
        [rng.normal(0, 3, 20000), rng.uniform(-1e5, 1e5, 20000), np.arange(-9999, 9999) * np.pi / 4]
    )
    found = np.array([cos_sin(angle) for angle in angles])
    for column, function in enumerate((np.cos, np.sin)):
        assert np.abs(found[:, column] - exactly(function, angles)).max() < (3e-16 if WIDE else 5e-16)


@pytest.mark.parametrize("angle", [1e5, 123456.789, -3e9, 1e300, -1.7e308])
def test_cosines_of_great_angles_are_those_of_angles_a_few_ulp_away(angle):
    cos, sin = cos_sin(angle)
    assert np.hypot(cos, sin) == pytest.approx(1.0, abs=1e-15)
    if abs(angle) < 1e12:
        assert (cos, sin) == pytest.approx((np.cos(angle), np.sin(angle)), abs=4 * np.spacing(abs(angle)))


def test_cosines_of_what_is_no_finite_number_are_no_numbers():
    assert np.isnan([cos_sin(value) for value in (np.inf, -np.inf, np.nan)]).all()


def test_whole_numbers_are_those_of_numpy():
    rng = np.random.default_rng(0)
    values = [*rng.normal(0, 1e3, 500), *np.arange(-9, 9) / 2, 0.49999999999999994, -1e-300, -0.0, 1e15, -1e15 + 0.125]
    assert [whole_below(value) for value in values] == np.floor(values).tolist()
    assert [nearest(value) for value in values] == np.rint(values).tolist()


def test_float32_arguments_are_widened_before_anything_is_rounded():
    x, y = np.float32(0.3), np.float32(-1.7)
    assert atan2(y, x) == atan2(float(y), float(x))
    assert exp(x) == exp(float(x))
    assert cos_sin(x) == cos_sin(float(x))


@pytest.mark.parametrize("function", [exp, atan2, cos_sin], ids=lambda function: function.__name__)
def test_nothing_is_contracted_into_fused_operations(function):
    """A fused multiplication and addition rounds once where others round twice: bytes would depend on the processor."""
    import numba

    arguments = "y[i], x[i]" if function is atan2 else "x[i]"
    names = {"one": function}
    exec(f"def call(y, x, out):\n for i in range(x.shape[0]):\n  out[i] = one({arguments})", names)
    if function is cos_sin:
        exec("def call(y, x, out):\n for i in range(x.shape[0]):\n  out[i] = one(x[i])[0]", names)
    call = numba.njit(error_model="numpy")(names["call"])
    call(np.ones(9), np.ones(9), np.ones(9))
    (code,) = call.inspect_asm().values()
    assert re.search(r"mulp?s?d|fmul", code)
    assert not re.search(r"\bv?fn?m(add|sub)|\bfml[as]\b", code)
