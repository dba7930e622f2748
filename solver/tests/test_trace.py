"""Traced formulas: values, exact derivatives, scalar equations, and the machine code made of them."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from skinrig_solver.lower import Formulas, Kernels
from skinrig_solver.trace import Expr, derivatives, exp, expm1, listing, log, power, root, select, sqrt, substitute
from skinrig_solver.trace import variables as named

X, Y = named("x", "y")
(DT,) = named("dt")


def cubic(t: Expr, a: Expr, b: Expr) -> Expr:
    return t * t * t + a * t - b


FORMULAS = {
    "rational": (X * Y + 3.0) / (X - 2.0 * Y) - (-X),
    "transcendental": exp(-X * Y) * log(X + Y) + sqrt(X * X + 1.0) + expm1(Y),
    "powers": power(X, 3) + power(Y, -1.0 / 3.0) + power(X, Y) + power(Y, 0.5) + power(X, -1.0),
    "choice": select(X - Y, X * X, Y * X),
    "root": root(cubic, 0.0, 10.0, X, (X, Y), 1e-14) * Y,
}


@cache
def compiled(name: str):  # type: ignore[no-untyped-def]
    """Values and their derivatives carried forward, and the derivatives' own formulas, of (x, y)."""
    row = derivatives([FORMULAS[name]], [X, Y])[0]
    graph = Formulas((X, Y), (), (), DT, (FORMULAS[name], row[X], row[Y]), ())
    code, roots = Kernels(lambda: graph).stress_tangent, len(graph.roots)

    @njit
    def run(kin, none, dt, memory, out, tangent):  # type: ignore[no-untyped-def]
        code(0, 1, kin, none, none[0], dt, memory, out, tangent)

    def evaluate(x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
        out, tangent = np.empty((1, 3)), np.empty((1, 3, 2))
        run(np.array([[x, y]]), np.zeros((1, 1)), 0.0, np.full((1, roots), np.nan), out, tangent)
        return out[0], tangent[0]

    return evaluate


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(sorted(FORMULAS)), st.floats(0.5, 3.0), st.floats(0.3, 0.9))
def test_derivatives_agree_with_differences(name: str, x: float, y: float) -> None:
    if abs(x - y) < 1e-3 or abs(x - 2.0 * y) < 0.05:
        return  # a kink and a pole
    f, h = compiled(name), 1e-6
    (_, *formulas), (forward, *_) = f(x, y)
    differences = [
        (f(x + h, y)[0][0] - f(x - h, y)[0][0]) / (2 * h),
        (f(x, y + h)[0][0] - f(x, y - h)[0][0]) / (2 * h),
    ]
    for a, b, c in zip(formulas, forward, differences, strict=True):
        assert math.isclose(a, b, rel_tol=1e-12, abs_tol=1e-12)
        assert math.isclose(a, c, rel_tol=1e-6, abs_tol=1e-6)


def test_root_solves_its_equation() -> None:
    value = compiled("root")(2.0, 0.7)[0][0] / 0.7
    assert math.isclose(value**3 + 2.0 * value, 0.7, rel_tol=1e-12)


def test_equal_expressions_are_one_node_and_constants_fold() -> None:
    assert (X + Y) is (Y + X)
    assert X * 1.0 is X
    assert (X - X).extra == 0.0
    assert substitute(X * X + Y, {Y: X}) is X * X + X


def test_a_listing_names_the_formula_and_no_accident_of_its_making() -> None:
    before = listing([exp(X) * Y])
    exp(X * 17.0)  # takes a number of the process
    assert listing([exp(X) * Y]) == before
    assert listing([exp(X) * X]) != before
    tighter = root(cubic, 0.0, 10.0, X, (X, Y), 1e-9)
    assert listing([tighter]) != listing([FORMULAS["root"] / Y])
