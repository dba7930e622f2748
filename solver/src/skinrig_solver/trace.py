"""Formulas written once, differentiated exactly, and turned into straight-line code.

A law is an ordinary Python function of :class:`Expr` objects. Running it builds an expression graph in which equal
expressions are one node; :func:`derivatives` differentiates the graph in forward mode (node by node, zeros never
stored), :func:`chained` lists the steps of the same, and `lower` compiles them. The vocabulary beyond ``+ - * / **``:
``sqrt``, ``exp``, ``expm1``, ``log``, ``power``, ``select``, and ``root``, a scalar equation that is differentiated by
the implicit-function theorem.

>>> x, y = variables("x", "y")
>>> f = exp(x * y) + x
>>> [str(d) for d in derivatives([f], [x])[0].values()]
['(1.0 + (y * exp((x * y))))']
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Union

Number = Union["Expr", float]
_nodes: dict[tuple[object, ...], Expr] = {}


class Expr:
    """One node: an operation on other nodes. Equal expressions are the same object."""

    __slots__ = ("args", "extra", "index", "op")

    def __init__(self, op: str, args: tuple[Expr, ...], extra: object) -> None:
        self.op, self.args, self.extra, self.index = op, args, extra, len(_nodes)

    def __add__(self, other: Number) -> Expr:
        a, b = self, lift(other)
        if _is(a, 0.0):
            return b
        if _is(b, 0.0):
            return a
        if b.op == "neg":
            return _make("sub", a, b.args[0])
        return _fold("add", *sorted((a, b), key=_order))

    def __mul__(self, other: Number) -> Expr:
        a, b = self, lift(other)
        if _is(a, 0.0) or _is(b, 0.0):
            return lift(0.0)
        for one, rest in ((a, b), (b, a)):
            if _is(one, 1.0):
                return rest
            if _is(one, -1.0):
                return -rest
            if one.op == "neg":
                return -(one.args[0] * rest)
        return _fold("mul", *sorted((a, b), key=_order))

    def __neg__(self) -> Expr:
        if self.op == "const":
            return lift(-_value(self))
        return self.args[0] if self.op == "neg" else _make("neg", self)

    def __sub__(self, other: Number) -> Expr:
        a, b = self, lift(other)
        if a is b:
            return lift(0.0)
        return -b if _is(a, 0.0) else a if _is(b, 0.0) else _fold("sub", a, b) if b.op != "neg" else a + b.args[0]

    def __truediv__(self, other: Number) -> Expr:
        a, b = self, lift(other)
        if b.op == "const":
            return a * (1.0 / _value(b))
        return lift(0.0) if _is(a, 0.0) else _fold("div", a, b)

    def __pow__(self, other: Number) -> Expr:
        return power(self, other)

    def __radd__(self, other: float) -> Expr:
        return self + other

    def __rmul__(self, other: float) -> Expr:
        return self * other

    def __rsub__(self, other: float) -> Expr:
        return lift(other) - self

    def __rtruediv__(self, other: float) -> Expr:
        return lift(other) / self

    def __str__(self) -> str:
        return _code(self, [str(a) for a in self.args])


_SYMBOL = {"add": "+", "sub": "-", "mul": "*", "div": "/"}


def _order(e: Expr) -> int:
    return e.index


def _value(e: Expr) -> float:
    assert isinstance(e.extra, float)
    return e.extra


def equation(e: Expr) -> tuple[Callable[..., Expr], float]:
    assert isinstance(e.extra, tuple)
    residual, tolerance = e.extra
    return residual, tolerance


def _is(e: Expr, value: float) -> bool:
    return e.op == "const" and e.extra == value


def _make(op: str, *args: Expr, extra: object = None) -> Expr:
    key = (op, *(a.index for a in args), extra)
    node = _nodes.get(key)
    if node is None:
        node = _nodes[key] = Expr(op, args, extra)
    return node


def _fold(op: str, a: Expr, b: Expr) -> Expr:
    if a.op == b.op == "const":
        x, y = _value(a), _value(b)
        return lift({"add": x + y, "sub": x - y, "mul": x * y}[op] if op != "div" else x / y)
    return _make(op, a, b)


def lift(value: Number) -> Expr:
    """A number as a node; a node as itself."""
    return value if isinstance(value, Expr) else _make("const", extra=float(value))


def variables(*names: str) -> tuple[Expr, ...]:
    """Named inputs."""
    return tuple(_make("var", extra=name) for name in names)


def sqrt(x: Number) -> Expr:
    return _make("sqrt", lift(x))


def exp(x: Number) -> Expr:
    return _make("exp", lift(x))


def expm1(x: Number) -> Expr:
    """exp(x) − 1 without cancellation."""
    return _make("expm1", lift(x))


def log(x: Number) -> Expr:
    return _make("log", lift(x))


def power(x: Number, y: Number) -> Expr:
    """x**y for x > 0 (any x for small whole y)."""
    x, y = lift(x), lift(y)
    if y.op == "const":
        n = _value(y)
        if n == int(n) and 0 <= n <= 8:
            result = lift(1.0)
            for _ in range(int(n)):
                result = result * x
            return result
        if n == 0.5:
            return sqrt(x)
        if n == -1.0:
            return 1.0 / x
    return _make("pow", x, y)


def select(condition: Number, positive: Number, otherwise: Number) -> Expr:
    """``positive`` where condition > 0, else ``otherwise``; both are evaluated, so both must be finite."""
    return _make("select", lift(condition), lift(positive), lift(otherwise))


def root(
    residual: Callable[..., Expr], lower: Number, upper: Number, start: Number, args: Sequence[Number], tolerance: float
) -> Expr:
    """The x in [lower, upper] with residual(x, *args) = 0, residual(lower) <= 0 <= residual(upper).

    Solved by Newton steps that fall back on bisection; its derivative is −(∂residual/∂args)/(∂residual/∂x).
    """
    nodes = tuple(lift(a) for a in (lower, upper, start, *args))
    return _make("root", *nodes, extra=(residual, tolerance))


def _partials(e: Expr) -> list[tuple[Expr, Expr]]:
    """(argument, ∂e/∂argument) pairs."""
    a = e.args
    match e.op:
        case "add" | "sub":
            return [(a[0], lift(1.0)), (a[1], lift(1.0 if e.op == "add" else -1.0))]
        case "neg":
            return [(a[0], lift(-1.0))]
        case "mul":
            return [(a[0], a[1]), (a[1], a[0])]
        case "div":
            inverse = 1.0 / a[1]
            return [(a[0], inverse), (a[1], -(e * inverse))]
        case "sqrt":
            return [(a[0], 0.5 / e)]
        case "exp":
            return [(a[0], e)]
        case "expm1":
            return [(a[0], e + 1.0)]
        case "log":
            return [(a[0], 1.0 / a[0])]
        case "pow":
            pairs = [(a[0], a[1] * e / a[0])]
            return pairs if a[1].op == "const" else [*pairs, (a[1], e * log(a[0]))]
        case "select":
            return [(a[1], select(a[0], 1.0, 0.0)), (a[2], select(a[0], 0.0, 1.0))]
        case "root":
            return _root_partials(e)
    return []


def _root_partials(e: Expr) -> list[tuple[Expr, Expr]]:
    residual, _ = equation(e)
    inputs = e.args[3:]
    names = variables(*(f"@{e.index}.{i}" for i in range(len(inputs) + 1)))
    rows = derivatives([residual(*names)], names)[0]
    values = dict(zip(names, (e, *inputs), strict=True))
    slope = 1.0 / substitute(rows[names[0]], values)
    return [
        (argument, -(substitute(rows[name], values) * slope))
        for name, argument in zip(names[1:], inputs, strict=True)
        if name in rows
    ]


def ordered(outputs: Sequence[Expr]) -> list[Expr]:
    """Every node the outputs need, each after its arguments."""
    seen: set[Expr] = set()
    order: list[Expr] = []
    stack = [(e, False) for e in reversed(outputs)]
    while stack:
        e, done = stack.pop()
        if done:
            order.append(e)
        elif e not in seen:
            seen.add(e)
            stack.append((e, True))
            stack.extend((a, False) for a in reversed(e.args) if a not in seen)
    return order


def derivatives(outputs: Sequence[Expr], inputs: Sequence[Expr]) -> list[dict[Expr, Expr]]:
    """For each output the mapping input -> ∂output/∂input; inputs it does not depend on are absent."""
    wanted = set(inputs)
    rows: dict[Expr, dict[Expr, Expr]] = {}
    for e in ordered(outputs):
        rows[e] = {e: lift(1.0)} if e in wanted else _row(e, rows)
    return [rows[e] for e in outputs]


@dataclass(frozen=True)
class Chain:
    """A forward differentiation in steps: (node, {base: ∂node/∂base}), where a base is an input or an earlier node.

    ``rows`` the same of each output. A node becomes a base where it depends on two others, so that what follows from
    it alone costs scalars, not directions.
    """

    steps: list[tuple[Expr, dict[Expr, Expr]]]
    rows: list[dict[Expr, Expr]]

    @property
    def coefficients(self) -> list[Expr]:
        """Whatever must be known before the derivatives."""
        return [c for row in (*(row for _, row in self.steps), *self.rows) for c in row.values()]


def chained(outputs: Sequence[Expr], inputs: Sequence[Expr]) -> Chain:
    """The steps by which the outputs' derivatives by the inputs follow from one another."""
    wanted = set(inputs)
    rows: dict[Expr, dict[Expr, Expr]] = {}
    steps: list[tuple[Expr, dict[Expr, Expr]]] = []
    for e in ordered(outputs):
        row = {e: lift(1.0)} if e in wanted else _row(e, rows)
        if len(row) > 1:
            steps.append((e, row))
            row = {e: lift(1.0)}
        rows[e] = row
    return Chain(steps, [rows[e] for e in outputs])


def _row(e: Expr, rows: Mapping[Expr, Mapping[Expr, Expr]]) -> dict[Expr, Expr]:
    """The derivative of a node from those of its arguments; zeros are left out."""
    row: dict[Expr, Expr] = {}
    if any(rows[a] for a in e.args):
        for argument, partial in _partials(e):
            for name, value in rows[argument].items():
                term = partial * value
                row[name] = row[name] + term if name in row else term
    return {name: value for name, value in row.items() if not _is(value, 0.0)}


def substitute(e: Expr, values: dict[Expr, Expr]) -> Expr:
    """The expression with variables replaced."""
    done: dict[Expr, Expr] = {}
    for node in ordered([e]):
        if node in values:
            done[node] = values[node]
        elif not node.args:
            done[node] = node
        else:
            done[node] = _rebuild(node, tuple(done[a] for a in node.args))
    return done[e]


def _rebuild(e: Expr, args: tuple[Expr, ...]) -> Expr:
    match e.op:
        case "add":
            return args[0] + args[1]
        case "sub":
            return args[0] - args[1]
        case "mul":
            return args[0] * args[1]
        case "div":
            return args[0] / args[1]
        case "neg":
            return -args[0]
        case "pow":
            return power(*args)
    return _make(e.op, *args, extra=e.extra)


def listing(outputs: Sequence[Expr]) -> str:
    """One line a node, the same for equal formulas in every process."""
    order = ordered(outputs)
    number = {e: i for i, e in enumerate(order)}
    lines = []
    for e in order:
        extra = e.extra
        if e.op == "root":
            residual, tolerance = equation(e)
            symbols = variables(*(f"@{i}" for i in range(len(e.args) - 2)))
            extra = (tolerance, listing([residual(*symbols)]))
        lines.append(f"{e.op} {[number[a] for a in e.args]} {extra!r}")
    return "\n".join([*lines, repr([number[e] for e in outputs])])


def _code(e: Expr, args: list[str]) -> str:
    if e.op in _SYMBOL:
        return f"({args[0]} {_SYMBOL[e.op]} {args[1]})"
    match e.op:
        case "const":
            return repr(_value(e))
        case "var":
            return str(e.extra)
        case "neg":
            return f"(-{args[0]})"
        case "pow":
            return f"({args[0]} ** {args[1]})"
        case "select":
            return f"({args[1]} if {args[0]} > 0.0 else {args[2]})"
    return f"{e.op}({', '.join(args)})"


def roots(outputs: Sequence[Expr]) -> list[Expr]:
    """The scalar equations that the outputs depend on."""
    return [e for e in ordered(outputs) if e.op == "root"]
