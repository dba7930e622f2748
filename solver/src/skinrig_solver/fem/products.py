"""Products of small matrices inside kernels, as LLVM instructions on vectors of four numbers.

Loops over a few columns, whose number is known only as they run, are compiled worst by LLVM: it makes vectors of eight
or thirty-two for long rows and leaves short ones to single numbers, and none at all where it cannot rule out that rows
of one matrix overlap. Fronts, elements and parameter directions have 4 to 60 columns.
"""

from __future__ import annotations

import inspect
from itertools import product
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 4  # numbers of a vector: a register of AVX2
# vectors of a row, their lanes and rows summed side by side: additions wait less for each other, loads serve many times
BLOCKS = ((3, LANES, 3), (2, LANES, 4), (1, LANES, 4), (1, LANES // 2, 4), (1, 1, 4))
FLAGS = ("contract",)
DOUBLE, INDEX = ir.DoubleType(), ir.IntType(64)
NAMES = "A first_a row_a column_a B first_b row_b C first_c row_c rows inner columns"


def _product(sign: int) -> Any:
    """An intrinsic: C (rows, columns) becomes C + ``sign`` A (rows, inner) B (inner, columns), or A B for sign 0."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        given = dict(zip(NAMES.split(), arguments, strict=True))
        for name, kind in zip("ABC", (sig.args[0], sig.args[4], sig.args[7]), strict=True):
            data = context.make_array(kind)(context, builder, given[name]).data
            given[name] = builder.gep(data, [given[f"first_{name.lower()}"]])
        _blocks(builder, given, sign)
        return context.get_dummy_value()

    def typed(_: Any, *kinds: Any) -> Any:
        matrices, numbers = (kinds[0], kinds[4], kinds[7]), [types.intp] * 3
        for kind in matrices:
            if not (isinstance(kind, types.Array) and kind.layout == "C" and kind.dtype == types.float64):
                raise TypeError(f"products take contiguous arrays of doubles, not {kind}")
        a, b, c = matrices
        return types.void(a, *numbers, b, *numbers[:2], c, *numbers[:2], *numbers), generate

    parameters = [inspect.Parameter(n, inspect.Parameter.POSITIONAL_OR_KEYWORD) for n in ("typing", *NAMES.split())]
    typed.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return intrinsic(typed)


def _blocks(b: Any, given: dict[str, Any], sign: int) -> None:
    """Columns by the first of `BLOCKS`, the rest of them by the next ones; rows in blocks, then one by one."""
    done: Any = INDEX(0)
    for vectors, lanes, high in BLOCKS:
        width = INDEX(vectors * lanes)
        end = b.sub(given["columns"], b.srem(b.sub(given["columns"], done), width))
        with cgutils.for_range_slice(b, done, end, width, inc=True) as (column, _):
            above: Any = INDEX(0)
            for rows in (high, 1):
                below = b.sub(given["rows"], b.srem(b.sub(given["rows"], above), INDEX(rows)))
                with cgutils.for_range_slice(b, above, below, INDEX(rows), inc=True) as (row, _):
                    _block(b, given, row, column, (rows, vectors, lanes), sign)
                above = below
        done = end


def _block(b: Any, given: dict[str, Any], row: Any, column: Any, size: tuple[int, int, int], sign: int) -> None:
    """``size``: rows, vectors of each, numbers of a vector. All sums stay in registers until they are done."""
    rows, _, lanes = size
    own = [b.add(row, INDEX(i)) for i in range(rows)]
    targets = [place for r in own for place in _places(b, given, "C", r, column, size)]
    beginnings = [b.mul(r, given["row_a"]) for r in own]
    before = b.block
    zero = ir.Constant(_kind(lanes), 0.0 if lanes == 1 else [0.0] * lanes)
    start = [b.load(place, align=8) if sign else zero for place in targets]
    check, body, after = (b.append_basic_block(f"product.{name}") for name in ("check", "body", "after"))
    b.branch(check)
    b.position_at_end(check)
    index, *sums = (_varying(b, value, before) for value in (INDEX(0), *start))
    b.cbranch(b.icmp_signed("<", index, given["inner"]), body, after)
    b.position_at_end(body)
    combine = b.fsub if sign < 0 else b.fadd
    for total, term in zip(sums, _terms(b, given, beginnings, index, column, size), strict=True):
        total.add_incoming(combine(total, term, flags=FLAGS), body)
    index.add_incoming(b.add(index, INDEX(1)), body)
    b.branch(check)
    b.position_at_end(after)
    for total, place in zip(sums, targets, strict=True):
        b.store(total, place, align=8)


def _terms(
    b: Any, given: dict[str, Any], beginnings: list[Any], index: Any, column: Any, size: tuple[int, int, int]
) -> list[Any]:
    """The gain of a block's sums from one ``index``: row after row, whose numbers of A lie at ``beginnings``."""
    along = b.mul(index, given["column_a"])
    taken = [b.load(place, align=8) for place in _places(b, given, "B", index, column, size)]
    factors = [b.load(b.gep(given["A"], [b.add(first, along)]), align=8) for first in beginnings]
    pairs = product([_spread(b, factor, size[2]) for factor in factors], taken)
    return [b.fmul(factor, value, flags=FLAGS) for factor, value in pairs]


def _varying(b: Any, start: Any, before: Any) -> Any:
    """A value of a loop, ``start`` as it is entered."""
    value = b.phi(start.type)
    value.add_incoming(start, before)
    return value


def _kind(lanes: int) -> Any:
    return DOUBLE if lanes == 1 else ir.VectorType(DOUBLE, lanes)


def _places(b: Any, given: dict[str, Any], matrix: str, row: Any, column: Any, size: tuple[int, int, int]) -> list[Any]:
    """Addresses of a row's vectors."""
    _, vectors, lanes = size
    first = b.add(b.mul(row, given[f"row_{matrix.lower()}"]), column)
    at = [b.gep(given[matrix], [b.add(first, INDEX(lanes * i))]) for i in range(vectors)]
    return [b.bitcast(place, _kind(lanes).as_pointer()) for place in at]


def _spread(b: Any, number: Any, lanes: int) -> Any:
    """The number in every lane."""
    if lanes == 1:
        return number
    vector = b.insert_element(ir.Constant(_kind(lanes), ir.Undefined), number, ir.IntType(32)(0))
    return b.shuffle_vector(vector, vector, ir.Constant(ir.VectorType(ir.IntType(32), lanes), [0] * lanes))


add_product = _product(1)
subtract_product = _product(-1)
set_product = _product(0)
