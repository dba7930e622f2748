"""Traced formulas: values, exact derivatives, scalar equations."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from skinrig_solver.trace import Expr, derivatives, emit, exp, log, power, root, select, sqrt, substitute, variables

X, Y = variables("x", "y")


def cubic(t: Expr, a: Expr, b: Expr) -> Expr:
    return t * t * t + a * t - b


FORMULAS = {
    "rational": (X * Y + 3.0) / (X - 2.0 * Y) - (-X),
    "transcendental": exp(-X * Y) * log(X + Y) + sqrt(X * X + 1.0),
    "powers": power(X, 3) + power(Y, -1.0 / 3.0) + power(X, Y) + power(Y, 0.5) + power(X, -1.0),
    "choice": select(X - Y, X * X, Y * X),
    "root": root(cubic, 0.0, 10.0, X, (X, Y), 1e-14) * Y,
}


def run(outputs: list[Expr], x: float, y: float) -> list[float]:
    lines, names = emit(outputs, {X: "x", Y: "y"}, "v")
    scope = {"x": x, "y": y, "sqrt": math.sqrt, "exp": math.exp, "log": math.log}
    exec("\n".join(lines), scope)
    return [float(eval(names[e], scope)) for e in outputs]


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(sorted(FORMULAS)), st.floats(0.5, 3.0), st.floats(0.3, 0.9))
def test_derivatives_agree_with_differences(name: str, x: float, y: float) -> None:
    if abs(x - y) < 1e-3 or abs(x - 2.0 * y) < 0.05:
        return  # a kink and a pole
    f, h = FORMULAS[name], 1e-6
    row = derivatives([f], [X, Y])[0]
    exact = run([row[X], row[Y]], x, y)
    differences = [
        (run([f], x + h, y)[0] - run([f], x - h, y)[0]) / (2 * h),
        (run([f], x, y + h)[0] - run([f], x, y - h)[0]) / (2 * h),
    ]
    for a, b in zip(exact, differences, strict=True):
        assert math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-6)


def test_root_solves_its_equation() -> None:
    t = root(cubic, 0.0, 10.0, 1.0, (X, Y), 1e-14)
    (value,) = run([t], 2.0, 0.7)
    assert math.isclose(value**3 + 2.0 * value, 0.7, rel_tol=1e-12)


def test_equal_expressions_are_one_node_and_constants_fold() -> None:
    assert (X + Y) is (Y + X)
    assert X * 1.0 is X
    assert (X - X).extra == 0.0
    assert substitute(X * X + Y, {Y: X}) is X * X + X
