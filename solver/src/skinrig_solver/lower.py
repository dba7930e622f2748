"""From expression graphs to machine code: the LLVM instructions of a law, inside the loop over its points.

numba takes milliseconds for every Python statement it types and lowers, and a law's derivatives would be thousands of
them. Here a graph becomes instructions directly, and derivatives are carried forward as vectors, all directions of a
node at once: fewer instructions both to compile and to run. numba compiles, calls and caches the result as it does its
own code (``numba.extending.intrinsic``).
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from . import trace
from .trace import Chain, Expr, chained, derivatives, variables

LANES = 4  # directions carried together: a register of AVX2
DOUBLE, INDEX = ir.DoubleType(), ir.IntType(64)
_MATH: dict[str, Callable[[float], float]] = {
    "sqrt": math.sqrt,
    "exp": math.exp,
    "expm1": math.expm1,
    "log": math.log,
}
_ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
ROOT_STEPS = 100

Vector = Any  # an LLVM value of doubles
Base = int | Vector  # a direction of its own, by its lane, or the derivatives of an input


class Code:
    """Instructions at one builder's position; ``values`` names the nodes that have been computed there.

    ``memory``: where the value of a root is kept, from which its next evaluation starts (nan at first).
    """

    def __init__(self, context: Any, builder: Any, values: dict[Expr, Any], memory: Mapping[Expr, Any]) -> None:
        self.context, self.builder, self.values, self.memory = context, builder, values, memory

    def scalars(self, outputs: Sequence[Expr]) -> list[Any]:
        """The outputs' values, with whatever they need."""
        for e in trace.ordered(outputs):
            if e not in self.values:
                self.values[e] = self._scalar(e)
        return [self.values[e] for e in outputs]

    def _scalar(self, e: Expr) -> Any:
        if e.op == "const":
            return ir.Constant(DOUBLE, e.extra)
        if e.op == "var":
            raise NameError(f"formula uses {e.extra!r}, which is not among its inputs")
        arguments, b = [self.values[a] for a in e.args], self.builder
        if e.op in _ARITHMETIC:
            return getattr(b, _ARITHMETIC[e.op])(*arguments)
        if e.op in _MATH:
            return self._call(_MATH[e.op], *arguments)
        match e.op:
            case "neg":
                return b.fneg(*arguments)
            case "pow":
                return b.call(b.module.declare_intrinsic("llvm.pow", [DOUBLE]), arguments)
            case "select":
                condition, positive, otherwise = arguments
                return b.select(b.fcmp_ordered(">", condition, ir.Constant(DOUBLE, 0.0)), positive, otherwise)
        return self._root(e, *arguments)

    def _call(self, function: Callable[[float], float], argument: Any) -> Any:
        compiled = self.context.get_function(function, types.float64(types.float64))
        return compiled(self.builder, [argument])

    def _root(self, e: Expr, lower: Any, upper: Any, start: Any, *arguments: Any) -> Any:
        """Newton steps that fall back on bisection."""
        residual, tolerance = trace.equation(e)
        symbols = variables(*(f"@{e.index}.{i}" for i in range(len(arguments) + 1)))
        value = residual(*symbols)
        slope = derivatives([value], symbols[:1])[0][symbols[0]]
        b = self.builder
        if place := self.memory.get(e):
            known = b.load(place)
            inside = b.and_(b.fcmp_ordered("<", lower, known), b.fcmp_ordered("<", known, upper))
            start = b.select(inside, known, start)
        low, high, at = (cgutils.alloca_once_value(b, v) for v in (lower, upper, start))  # type: ignore[no-untyped-call]
        with cgutils.for_range(b, INDEX(ROOT_STEPS)) as loop:
            x = b.load(at)
            inner = Code(self.context, b, dict(zip(symbols, (x, *arguments), strict=True)), {})
            f, df = inner.scalars([value, slope])
            above = b.fcmp_ordered(">", f, ir.Constant(DOUBLE, 0.0))
            left, right = b.select(above, b.load(low), x), b.select(above, x, b.load(high))
            step = b.fsub(x, b.fdiv(f, df))
            within = b.and_(b.fcmp_ordered(">=", step, left), b.fcmp_ordered("<=", step, right))
            step = b.select(within, step, b.fmul(ir.Constant(DOUBLE, 0.5), b.fadd(left, right)))
            for cell, new in ((low, left), (high, right), (at, step)):
                b.store(new, cell)
            share = ir.Constant(DOUBLE, tolerance)
            allowed = b.fmul(share, b.fadd(share, self._absolute(x)))
            with b.if_then(b.fcmp_ordered("<=", self._absolute(b.fsub(step, x)), allowed)):
                loop.do_break()
        found = b.load(at)
        if place:
            b.store(found, place)
        return found

    def _absolute(self, x: Any) -> Any:
        return self.builder.call(self.builder.module.declare_intrinsic("llvm.fabs", [DOUBLE]), [x])

    def vectors(self, chain: Chain, seeds: Mapping[Expr, Base], width: int) -> list[Vector]:
        """The derivatives of the chain's outputs in ``width`` directions; its coefficients must have been computed."""
        found: dict[Expr, Base] = dict(seeds)
        for node, row in chain.steps:
            found[node] = self._combined(row, found, width)
        return [self._combined(row, found, width) for row in chain.rows]

    def _combined(self, row: Mapping[Expr, Expr], found: Mapping[Expr, Base], width: int) -> Vector:
        """Σ coefficient · derivative."""
        b = self.builder
        lanes = {lane: c for node, c in row.items() if isinstance(lane := found[node], int)}
        total = self._lanes(lanes, width) if lanes or not row else None
        for node, coefficient in row.items():
            term = found[node]
            if isinstance(term, int):
                continue
            known = coefficient.extra if coefficient.op == "const" else None
            if known == -1.0 and total is not None:
                total = b.fsub(total, term)
                continue
            if known != 1.0:
                term = b.fmul(self._spread(self.values[coefficient], width), term)
            total = term if total is None else b.fadd(total, term)
        return total

    def _lanes(self, coefficients: Mapping[int, Expr], width: int) -> Vector:
        """A vector of these numbers in their lanes, 0 in the others."""
        total = ir.Constant(*((DOUBLE, 0.0) if width == 1 else (ir.VectorType(DOUBLE, width), [0.0] * width)))
        for lane, coefficient in coefficients.items():
            total = self.builder.insert_element(total, self.values[coefficient], ir.IntType(32)(lane))
        return total

    def _spread(self, value: Any, width: int) -> Vector:
        b = self.builder
        if width == 1:
            return value
        one = b.insert_element(ir.Constant(ir.VectorType(DOUBLE, width), ir.Undefined), value, ir.IntType(32)(0))
        return b.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width))


@dataclass
class Rows:
    """The rows of an array's data, C order: row i begins at ``data`` + i ``length``."""

    builder: Any
    data: Any
    length: Any

    def at(self, row: Any, column: Any) -> Any:
        """The address of an entry."""
        b = self.builder
        return b.gep(self.data, [b.add(b.mul(row, self.length), column)])

    def load(self, row: Any, column: Any, width: int = 1) -> Any:
        return self.builder.load(self._place(row, column, width), align=8)

    def store(self, value: Any, row: Any, column: Any, width: int = 1) -> None:
        self.builder.store(value, self._place(row, column, width), align=8)

    def _place(self, row: Any, column: Any, width: int) -> Any:
        place = self.at(row, column)
        return place if width == 1 else self.builder.bitcast(place, ir.VectorType(DOUBLE, width).as_pointer())


@dataclass(frozen=True)
class Formulas:
    """A law's graph, traced when its code is generated: (kin, state, par, dt) -> (stress, new state)."""

    kin: tuple[Expr, ...]
    state: tuple[Expr, ...]
    par: tuple[Expr, ...]
    dt: Expr
    stress: tuple[Expr, ...]
    new: tuple[Expr, ...]

    @cached_property
    def roots(self) -> list[Expr]:
        return trace.roots([*self.stress, *self.new])


class Points:
    """Generates the loop over points ``first`` to ``last`` of one of a law's kernels."""

    def __init__(
        self, formulas: Formulas, context: Any, builder: Any, arguments: Mapping[str, tuple[Any, Any]]
    ) -> None:
        self.formulas, self.context, self.builder = formulas, context, builder
        self.arguments = arguments  # name: (value, numba type)

    def value(self, name: str) -> Any:
        return self.arguments[name][0]

    def rows(self, name: str, length: Any) -> Rows:
        """``length``: of a row, a whole number or a value."""
        value, kind = self.arguments[name]
        data = self.context.make_array(kind)(self.context, self.builder, value).data
        return Rows(self.builder, data, INDEX(length) if isinstance(length, int) else length)

    @contextmanager
    def each(self, wanted: Sequence[Expr]) -> Iterator[tuple[Code, Any]]:
        """Inside the loop: code with the inputs of ``wanted`` loaded and the point's number; before it, constants."""
        own, b = self.formulas, self.builder
        par = self.rows("par", 1)
        fixed: dict[Expr, Any] = {p: par.load(INDEX(i), INDEX(0)) for i, p in enumerate(own.par)}
        fixed[own.dt] = self.value("dt")
        Code(self.context, b, fixed, {}).scalars(_independent(wanted, set(fixed)))
        first, last = self.value("first"), self.value("last")
        kin, state = self.rows("kin", len(own.kin)), self.rows("state", len(own.state))
        memory = self.rows("memory", len(own.roots))
        with cgutils.for_range(b, last, start=first) as loop:
            values = dict(fixed)
            values |= {x: kin.load(loop.index, INDEX(i)) for i, x in enumerate(own.kin)}
            values |= {x: state.load(loop.index, INDEX(i)) for i, x in enumerate(own.state)}
            kept = {e: memory.at(loop.index, INDEX(i)) for i, e in enumerate(own.roots)}
            yield Code(self.context, b, values, kept), loop.index


def _independent(outputs: Sequence[Expr], fixed: set[Expr]) -> list[Expr]:
    """The largest expressions under the outputs that depend on ``fixed`` alone."""
    own, needed = set(fixed), []
    for e in trace.ordered(outputs):
        if e.args and all(a in own or a.op == "const" for a in e.args):
            own.add(e)
        else:
            needed += [a for a in e.args if a in own and a.args]
    return needed


def stress(points: Points) -> None:
    own = points.formulas
    out, new = points.rows("out", len(own.stress)), points.rows("new", len(own.new))
    with points.each([*own.stress, *own.new]) as (code, g):
        for rows, targets in ((out, own.stress), (new, own.new)):
            for i, value in enumerate(code.scalars(targets)):
                rows.store(value, g, INDEX(i))


def stress_tangent(points: Points) -> None:
    own = points.formulas
    chain = chained(own.stress, own.kin)
    out, tangent = points.rows("out", len(own.stress)), points.rows("tangent", len(own.stress) * len(own.kin))
    width = len(own.kin)
    with points.each([*own.stress, *chain.coefficients]) as (code, g):
        for i, value in enumerate(code.scalars(own.stress)):
            out.store(value, g, INDEX(i))
        code.scalars(chain.coefficients)
        for i, row in enumerate(code.vectors(chain, {x: lane for lane, x in enumerate(own.kin)}, width)):
            tangent.store(row, g, INDEX(width * i), width)


def partials(points: Points) -> None:
    own, b = points.formulas, points.builder
    width, states, stresses = len(own.kin), len(own.state), len(own.stress)
    by_kin = chained([*own.stress, *own.new], own.kin)
    along = chained([*own.stress, *own.new], [*own.state, *own.par])
    m, whole = points.value("m"), points.value("whole")
    seeds, dstate = points.rows("seeds", m), points.rows("dstate", m)
    values = [(points.rows("out", stresses), own.stress), (points.rows("new", states), own.new)]
    kinematic = [(points.rows("tangent", stresses * width), stresses), (points.rows("by_kin", states * width), states)]
    targets = [(points.rows("dstress", m), stresses), (points.rows("dnew", m), states)]
    with points.each([*own.stress, *own.new, *by_kin.coefficients, *along.coefficients]) as (code, g):
        for rows, outputs in values:
            for i, value in enumerate(code.scalars(outputs)):
                rows.store(value, g, INDEX(i))
        code.scalars([*by_kin.coefficients, *along.coefficients])
        slopes = iter(code.vectors(by_kin, {x: lane for lane, x in enumerate(own.kin)}, width))
        for rows, count in kinematic:
            for i in range(count):
                rows.store(next(slopes), g, INDEX(width * i), width)

        def directions(k: Any, lanes: int) -> None:
            given: dict[Expr, Base] = {x: seeds.load(INDEX(i), k, lanes) for i, x in enumerate(own.par)}
            first = b.mul(g, INDEX(states))
            given |= {x: dstate.load(b.add(first, INDEX(i)), k, lanes) for i, x in enumerate(own.state)}
            found = iter(code.vectors(along, given, lanes))
            for rows, count in targets:
                first = b.mul(g, INDEX(count))
                for i in range(count):
                    rows.store(next(found), b.add(first, INDEX(i)), k, lanes)

        with cgutils.for_range_slice(b, INDEX(0), whole, INDEX(LANES), inc=True) as (k, _):
            directions(k, LANES)
        with cgutils.for_range(b, m, start=whole) as rest:
            directions(rest.index, 1)


class Kernels:
    """The intrinsics that a law's generated module calls; ``formulas`` is called only where they must be compiled."""

    def __init__(self, formulas: Callable[[], Formulas]) -> None:
        names = "first last kin state par dt memory"
        self.stress = _intrinsic(formulas, stress, f"{names} out new")
        self.stress_tangent = _intrinsic(formulas, stress_tangent, f"{names} out tangent")
        self.partials = _intrinsic(
            formulas, partials, f"{names} dstate seeds m whole out new tangent dstress dnew by_kin"
        )


def _intrinsic(formulas: Callable[[], Formulas], body: Callable[[Points], None], names: str) -> Any:
    """``body`` as a function of the named arguments that numba's functions can call."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        named = dict(zip(names.split(), zip(arguments, sig.args, strict=True), strict=True))
        body(Points(formulas(), context, builder, named))
        return context.get_dummy_value()

    def kernel(_: Any, *kinds: Any) -> Any:
        for kind in kinds:
            if isinstance(kind, types.Array) and not (kind.layout == "C" and kind.dtype == types.float64):
                raise TypeError(f"a law's kernels take contiguous arrays of doubles, not {kind}")
        return types.void(*kinds), generate

    # numba counts arguments by their names
    parameters = [inspect.Parameter(n, inspect.Parameter.POSITIONAL_OR_KEYWORD) for n in ("typing", *names.split())]
    kernel.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return intrinsic(kernel)
