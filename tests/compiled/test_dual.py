"""Dual numbers, in Python and compiled."""

from __future__ import annotations

import operator
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import dual_laws as laws
import numba
import numpy as np
import pytest

from fvswell.compiled import dual_numba
from fvswell.compiled.dual import Dual, constant, dual, slope_of, value_of, variables

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="what is compiled is compared with Python")

FLUX_POINT = (2.1e5, 0.55, 310.0, 0.07)
STEP = 1.0e-200


def compile_gradient(function, n):
    """Return a compiled function of n numbers that returns an array with the value and the slopes of a function."""
    names = ", ".join(f"x{i}" for i in range(n))
    slopes = "".join(f", slope_of(y, {i})" for i in range(n))
    source = f"def gradient({names}):\n    y = function(*variables({names}))\n    return (value_of(y){slopes},)\n"
    namespace = {"function": numba.njit(error_model="numpy")(function), "variables": variables}
    namespace.update(value_of=value_of, slope_of=slope_of)
    exec(source, namespace)
    return numba.njit(error_model="numpy")(namespace["gradient"])


def python_gradient(function, point):
    """Return an array with the value and the slopes of a function, found with Dual."""
    y = function(*variables(*point))
    return np.array([y.value, *y.slopes])


def complex_gradient(function, point):
    """Return an array with the value and the slopes of a function, found with a complex step."""
    slopes = []
    for i in range(len(point)):
        arguments = [np.complex128(x) for x in point]
        arguments[i] += 1j * STEP
        slopes.append(np.imag(function(*arguments)) / STEP)
    return np.array([function(*(np.float64(x) for x in point)), *slopes])


def random_expression(rng, depth, names):
    """Return the text of a random expression that is smooth and positive for positive arguments."""
    if depth == 0:
        return str(rng.choice(names))
    a = random_expression(rng, depth - 1, names)
    b = random_expression(rng, depth - 1, names)
    k = round(float(rng.uniform(0.5, 2.0)), 3)
    forms = (
        f"({a} + {b})",
        f"({a} + {k})",
        f"({k} + {a} * {b})",
        f"({k} * {a} * {b})",
        f"({a} / (1 + {b}))",
        f"(2 / (1.0 + {a}))",
        f"({k} - {a} / ({a} + 3) * 0.25 - -{b})",
        f"({a} / 3 + {b} * 2)",
        f"np.exp(-{a} / (1.0 + {b}))",
        f"np.log(1.5 + {a} * {b})",
        f"np.sqrt({a} + {k})",
        f"np.tanh({a})",
        f"(np.sinh({a} / (1.0 + {a})) + np.cosh({b} / (1.0 + {b})))",
        f"({a} / (1.0 + {a})) ** 2",
        f"(1.0 + {b}) ** -3",
        f"(0.5 + {a}) ** {k}",
        f"(0.5 + {a}) ** ({b} / (1.0 + {b}))",
        f"{k} ** ({a} / (1.0 + {a}))",
    )
    return forms[rng.integers(len(forms))]


def assert_close(found, expected, tolerance=1.0e-14):
    """Check that two gradients agree relative to the largest slope."""
    assert found[0] == pytest.approx(expected[0], rel=tolerance)
    np.testing.assert_allclose(found[1:], expected[1:], rtol=tolerance, atol=tolerance * np.max(np.abs(expected[1:])))


@pytest.mark.parametrize("seed", range(24))
def test_random_expressions_agree_with_complex_step(seed):
    """One expression of each number of directions is compiled as well."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 8
    names = [f"x{i}" for i in range(n)]
    function = eval(f"lambda {', '.join(names)}: {random_expression(rng, 4, names)} + {' + '.join(names)}", {"np": np})
    point = tuple(rng.uniform(0.3, 1.8, n).tolist())
    expected = complex_gradient(function, point)
    assert_close(python_gradient(function, point), expected)
    if seed < 8:
        assert_close(compile_gradient(function, n)(*point), expected)


def test_flux():
    found = compile_gradient(laws.flux, 4)(*FLUX_POINT)
    assert_close(found, python_gradient(laws.flux, FLUX_POINT))
    compiled_float = numba.njit(error_model="numpy")(lambda p, s, t, c: laws.flux(p, s, t, c))
    assert found[0] == pytest.approx(compiled_float(*FLUX_POINT), rel=1.0e-14)


OPERATIONS = {
    "x + y": lambda x, y: x + y,
    "x - y": lambda x, y: x - y,
    "x * y": lambda x, y: x * y,
    "x / y": lambda x, y: x / y,
    "x ** y": lambda x, y: x**y,
}


@pytest.mark.parametrize("name", OPERATIONS)
@pytest.mark.parametrize("kinds", ["dd", "df", "fd", "di", "id"])
def test_operand_kinds(name, kinds):
    function = OPERATIONS[name]
    left, right = 3.0, 2.0

    operation = numba.njit(error_model="numpy")(function)

    convert = {"f": float, "i": int, "d": float}
    expected = python_gradient(
        lambda a, b: function(
            a if kinds[0] == "d" else convert[kinds[0]](left), b if kinds[1] == "d" else convert[kinds[1]](right)
        ),
        (left, right),
    )
    source = f"""def gradient(left, right):
    a, b = variables(float(left), float(right))
    z = operation({"a" if kinds[0] == "d" else "left"}, {"b" if kinds[1] == "d" else "right"})
    return value_of(z), slope_of(z, 0), slope_of(z, 1)
"""
    namespace = {"operation": operation, "variables": variables, "value_of": value_of, "slope_of": slope_of}
    exec(source, namespace)
    gradient = numba.njit(error_model="numpy")(namespace["gradient"])
    found = gradient(convert[kinds[0]](left), convert[kinds[1]](right))
    np.testing.assert_allclose(found, expected, rtol=1.0e-14)


@cache
def power_gradient(fastmath):
    """Return a compiled function of base and exponent that returns a power and its slope by the base."""

    @numba.njit(error_model="numpy", fastmath=set(fastmath) or False)
    def gradient(base, exponent):
        (x,) = variables(base)
        y = x**exponent
        return value_of(y), slope_of(y, 0)

    return gradient


@pytest.mark.parametrize(
    ("base", "exponent", "value", "slope"),
    [
        (0.0, 2.0, 0.0, 0.0),
        (0.0, 1.5, 0.0, 0.0),
        (0.0, 1.0, 0.0, 1.0),
        (0.0, 0.5, 0.0, np.inf),
        (0.0, 0.0, 1.0, 0.0),
        (2.0, 0.0, 1.0, 0.0),
        (-2.0, 3.0, -8.0, 12.0),
        (1.0e-200, 2.0, 0.0, 2.0e-200),
        (np.inf, 0.5, np.inf, 0.0),
        (np.inf, 2.0, np.inf, np.inf),
        (-1.0, 0.5, np.nan, np.nan),
        (0.0, -1.0, np.inf, -np.inf),
    ],
)
@pytest.mark.parametrize("fastmath", [(), ("nsz", "arcp", "contract", "reassoc")], ids=["exact", "fast"])
def test_special_powers(base, exponent, value, slope, fastmath):
    np.testing.assert_allclose(power_gradient(fastmath)(base, exponent), (value, slope), rtol=1.0e-14)
    with np.errstate(all="ignore"):
        y = variables(base)[0] ** exponent
    np.testing.assert_allclose((y.value, y.slopes[0]), (value, slope), rtol=1.0e-14)


@pytest.mark.parametrize("base", [-1.7, 0.0, 2.3])
def test_constant_integer_powers(base):
    def law(x):
        return x**0 + x**1 + x**2 + x**3 + x**7 + x**64 * 1.0e-9 + (x + 5.0) ** -1 + (x + 5.0) ** -2

    with np.errstate(all="ignore"):
        expected = python_gradient(law, (base,))
    np.testing.assert_allclose(compile_gradient(law, 1)(base), expected, rtol=1.0e-14)


def test_large_integer_power_uses_general_power():
    found = compile_gradient(lambda x: x**200, 1)(1.01)
    np.testing.assert_allclose(found, (1.01**200, 200 * 1.01**199), rtol=1.0e-13)


@pytest.mark.parametrize("x", [-1.5, 0.0, 1.5])
def test_abs_signs_and_inplace_operators(x):
    def law(x, y):
        z = abs(x) + np.absolute(x) * 2.0 + np.negative(x)
        z += y
        z -= 2
        z *= x
        z /= 4.0 + y
        w = +z
        w **= 2
        return w - -z

    expected = python_gradient(law, (x, 0.5))
    np.testing.assert_allclose(compile_gradient(law, 2)(x, 0.5), expected, rtol=1.0e-14, atol=1.0e-16)


def test_division_by_zero_does_not_raise():
    def law(x):
        return 1.0 / x

    assert compile_gradient(law, 1)(0.0) == (np.inf, -np.inf)
    with np.errstate(all="ignore"):
        assert tuple(python_gradient(law, (0.0,))) == (np.inf, -np.inf)


@pytest.mark.parametrize("symbol", ["lt", "le", "gt", "ge", "eq", "ne"])
def test_comparisons(symbol):
    compare = getattr(operator, symbol)

    @numba.njit
    def compiled(a, b):
        x, y = variables(a, b)
        return compare(x, y), compare(x, b), compare(a, y), compare(x, 1), compare(1, y)

    for a in (0.5, 1.0, 2.0, np.nan):
        x, y = variables(a, 1.0)
        expected = (compare(a, 1.0),) * 4 + (compare(1, 1.0),)
        assert compiled(a, 1.0) == expected
        assert (compare(x, y), compare(x, 1.0), compare(a, y), compare(x, 1), compare(1, y)) == expected


def test_branches_may_mix_floats_and_duals():
    @numba.njit
    def law(x):
        return x * x if x > 1.0 else 0.0

    @numba.njit
    def gradient(a):
        (x,) = variables(a)
        total = 0
        for _ in range(3):
            total = total + law(x)
        return value_of(total), slope_of(total, 0)

    assert gradient(2.0) == (12.0, 12.0)
    assert gradient(0.5) == (0.0, 0.0)


def test_scalar_kinds():
    @numba.njit
    def gradient(a, f4, i4, flag):
        (x,) = variables(a)
        y = x * f4 + i4 * x - flag * x + x / i4
        return value_of(y), slope_of(y, 0)

    assert gradient(2.0, np.float32(0.5), np.int32(4), True) == (7.5, 3.75)


def test_constructors_and_accessors_compiled():
    @numba.njit
    def build(a, b):
        x = dual(a, (b, 2, 0.5))
        y = constant(3, 3)
        z = x * y
        total = 0.0
        for j in range(3):
            total += slope_of(z, j)
        return value_of(z), value_of(b), value_of(7), slope_of(z, 0), slope_of(y, 2), total

    assert build(2.0, 4.0) == (6.0, 4.0, 7, 12.0, 0.0, 19.5)


def test_different_numbers_of_directions_do_not_mix():
    @numba.njit
    def mixed(a):
        return value_of(constant(a, 2) + constant(a, 3))

    with pytest.raises(numba.TypingError):
        mixed(1.0)
    with pytest.raises(ValueError, match="zip"):
        constant(1.0, 2) + constant(1.0, 3)


@pytest.mark.parametrize("n", [1, 2, 4, 8])
def test_duals_survive_functions_tuples_and_lists(n):
    row = ", ".join(f"a + {j}" for j in range(n))
    source = f"def make(a):\n    return dual(a, ({row},))\n"
    namespace = {"dual": dual}
    exec(source, namespace)
    make = numba.njit(namespace["make"])

    @numba.njit
    def pack(x):
        return laws.State(x * 2.0, 0.5, 3, (x, 1, x * x))

    @numba.njit
    def gradient(a):
        items = [pack(make(a)).flux]
        for _ in range(5):
            items.append(items[-1] + make(a))
        state = pack(items.pop())
        total = state.square[2] * state.scale + state.index + state.square[0]
        out = np.empty(n + 1)
        out[0] = value_of(total)
        for j in range(n):
            out[1 + j] = slope_of(total, j)
        return out

    a = 1.25
    x = 7.0 * Dual(a, tuple(a + j for j in range(n)))
    expected = x * x * 0.5 + 3 + x
    np.testing.assert_allclose(gradient(a), [expected.value, *expected.slopes], rtol=1.0e-14)


def test_generators_keep_duals():
    @numba.njit
    def powers(x):
        y = x
        for _ in range(4):
            yield y
            y = y * x

    @numba.njit
    def gradient(a, b):
        x = dual(a, (b, 1.0, 2.0, 3.0, 4.0))
        total = constant(0.0, 5)
        for y in powers(x):
            total += y
        return value_of(total), slope_of(total, 0), slope_of(total, 4)

    assert gradient(2.0, 1.0) == (30.0, 49.0, 196.0)


def test_arrays_in_python():
    x, y = variables(np.array([1.0, 2.0, 3.0]), 2.0)
    weights = np.array([0.5, 1.0, 2.0])
    for z in (weights * x, x * weights, np.multiply(weights, x)):
        np.testing.assert_array_equal(z.value, [0.5, 2.0, 6.0])
        np.testing.assert_array_equal(z.slopes[0], weights)
    np.testing.assert_allclose((weights / x).slopes[0], -weights / x.value**2, rtol=1.0e-15)
    np.testing.assert_allclose((weights - x).slopes[0], -1.0)
    np.testing.assert_allclose((weights**x).slopes[0], weights**x.value * np.log(weights), rtol=1.0e-15)
    np.testing.assert_allclose((x**y).slopes[1], x.value**2 * np.log(x.value), rtol=1.0e-15)
    np.testing.assert_array_equal(weights < x, weights < x.value)
    np.testing.assert_array_equal(x >= weights, x.value >= weights)
    np.testing.assert_allclose(np.exp(x).slopes[0], np.exp(x.value))
    assert isinstance(np.float64(2.0) * y, Dual)
    assert (np.float64(2.0) * y).slopes == (0.0, 2.0)
    assert (np.float64(2.0) - y) == 0.0
    with pytest.raises(TypeError):
        np.arctan(x)


def test_integers_in_python():
    (x,) = variables(2)
    y = x**-2 + 2**x
    assert y.value == 4.25
    assert y.slopes[0] == pytest.approx(-0.25 + 4.0 * np.log(2.0), rel=1.0e-15)


def test_compiled_function_refuses_python_duals_and_other_types():
    with pytest.raises(numba.TypingError):
        numba.njit(lambda x: x + 1.0)(constant(1.0, 2))
    with pytest.raises(numba.TypingError):
        numba.njit(lambda a: value_of(constant(a, 2) + 1j))(1.0)
    assert dual_numba.DualType(3) == dual_numba.DualType(3)


def test_fastmath_and_parallel_loops():
    flux = numba.njit(error_model="numpy")(lambda p, s, t, c: laws.flux(p, s, t, c))

    @numba.njit(error_model="numpy", parallel=True, fastmath={"contract", "arcp", "nsz"})
    def kernel(x, out):
        for i in numba.prange(x.shape[0]):
            p, s, t, c = variables(x[i, 0], x[i, 1], x[i, 2], x[i, 3])
            f = flux(p, s, t, c)
            out[i, 0] = value_of(f)
            for j in range(4):
                out[i, 1 + j] = slope_of(f, j)

    x = np.tile(FLUX_POINT, (10, 1))
    out = np.empty((10, 5))
    kernel(x, out)
    np.testing.assert_allclose(out, np.tile(python_gradient(laws.flux, FLUX_POINT), (10, 1)), rtol=1.0e-12)


def test_cached_function_is_loaded_in_a_second_process(tmp_path):
    code = (
        "import dual_laws as laws\n"
        "result = laws.cached(2.0, 3.0)\n"
        "assert abs(result[0] - 40.0 / 3.0) < 1e-14, result\n"
        "print(sum(laws.cached.stats.cache_hits.values()), sum(laws.cached.stats.cache_misses.values()))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}

    def run():
        command = [sys.executable, "-c", code]
        folder = Path(__file__).parent
        return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True).stdout

    assert run().split() == ["0", "1"]
    assert run().split() == ["1", "0"]
