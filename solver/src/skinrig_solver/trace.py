"""Formulas written once, differentiated exactly, and turned into straight-line code.

A law is an ordinary Python function of :class:`Expr` objects. Running it builds an expression graph in which equal
expressions are one node; :func:`derivatives` differentiates the graph in forward mode (node by node, zeros never
stored); :func:`emit` writes the wanted nodes as assignments. The vocabulary beyond ``+ - * / **``: ``sqrt``, ``exp``,
``expm1``, ``log``, ``power``, ``select``, and ``root``, a scalar equation that is differentiated by the
implicit-function theorem.

>>> x, y = variables("x", "y")
>>> f = exp(x * y) + x
>>> [str(d) for d in derivatives([f], [x])[0].values()]
['(1.0 + (y * exp((x * y))))']
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
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


def _equation(e: Expr) -> tuple[Callable[..., Expr], float]:
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
        case "add":
            return [(a[0], lift(1.0)), (a[1], lift(1.0))]
        case "sub":
            return [(a[0], lift(1.0)), (a[1], lift(-1.0))]
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
            residual, _ = _equation(e)
            inputs = a[3:]
            names = variables(*(f"@{e.index}.{i}" for i in range(len(inputs) + 1)))
            rows = derivatives([residual(*names)], names)[0]
            values = dict(zip(names, (e, *inputs), strict=True))
            slope = 1.0 / substitute(rows[names[0]], values)
            return [
                (argument, -(substitute(rows[name], values) * slope))
                for name, argument in zip(names[1:], inputs, strict=True)
                if name in rows
            ]
    return []


def _ordered(outputs: Sequence[Expr]) -> list[Expr]:
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
    for e in _ordered(outputs):
        row: dict[Expr, Expr] = {e: lift(1.0)} if e in wanted else {}
        if not row and any(rows[a] for a in e.args):
            for argument, partial in _partials(e):
                for name, value in rows[argument].items():
                    term = partial * value
                    row[name] = row[name] + term if name in row else term
        rows[e] = {name: value for name, value in row.items() if not _is(value, 0.0)}
    return [rows[e] for e in outputs]


def substitute(e: Expr, values: dict[Expr, Expr]) -> Expr:
    """The expression with variables replaced."""
    done: dict[Expr, Expr] = {}
    for node in _ordered([e]):
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
    return [e for e in _ordered(outputs) if e.op == "root"]


def emit(
    outputs: Sequence[Expr], known: dict[Expr, str], prefix: str, memory: Mapping[Expr, str] | None = None
) -> tuple[list[str], dict[Expr, str]]:
    """Assignments that compute the outputs, and the name each node has afterwards.

    ``known`` names nodes already computed (inputs, or nodes hoisted out of a loop). Names start with ``prefix``.
    ``memory`` names places that keep a root's value for the next evaluation to start from (nan at first).
    """
    lines: list[str] = []
    names = dict(known)
    for e in _ordered(outputs):
        if e in names:
            continue
        if e.op == "const":
            value = _value(e)
            names[e] = repr(value) if value >= 0 or math.isnan(value) else f"({value!r})"
        elif e.op == "var":
            raise NameError(f"formula uses {e.extra!r}, which is not among its inputs")
        else:
            names[e] = f"{prefix}{e.index}"
            arguments = [names[a] for a in e.args]
            if e.op == "root":
                lines += _root_lines(e, names[e], arguments, (memory or {}).get(e))
            else:
                lines.append(f"{names[e]} = {_code(e, arguments)}")
    return lines, names


def _root_lines(e: Expr, name: str, arguments: list[str], memory: str | None) -> list[str]:
    residual, tolerance = _equation(e)
    symbols = variables(*(f"@{name}.{i}" for i in range(len(arguments) - 2)))
    value = residual(*symbols)
    slope = derivatives([value], symbols[:1])[0][symbols[0]]
    known = dict(zip(symbols, (name, *arguments[3:]), strict=True))
    body, names = emit([value, slope], known, f"{name}_")
    low, high, step = f"{name}_low", f"{name}_high", f"{name}_step"
    recall = [f"if {low} < {memory} < {high}:", f"    {name} = {memory}"] if memory else []
    return [
        f"{low}, {high}, {name} = {arguments[0]}, {arguments[1]}, {arguments[2]}",
        *recall,
        "for _ in range(100):",
        *(f"    {line}" for line in body),
        f"    if {names[value]} > 0.0:",
        f"        {high} = {name}",
        "    else:",
        f"        {low} = {name}",
        f"    {step} = {name} - {names[value]} / {names[slope]}",
        f"    if not ({low} <= {step} <= {high}):",
        f"        {step} = 0.5 * ({low} + {high})",
        f"    {low}_done = abs({step} - {name}) <= {tolerance!r} * ({tolerance!r} + abs({name}))",
        f"    {name} = {step}",
        f"    if {low}_done:",
        "        break",
        *([f"{memory} = {name}"] if memory else []),
    ]
