"""From one response function to compiled kernels: stress, tangent, state update, and derivatives by any parameter.

The generated module lives in the user's cache folder (``SKINRIG_CACHE_DIR``, else ``NUMBA_CACHE_DIR``, else the
platform's), keyed by the sources it came from, so tracing and compilation happen once per machine and law.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import ModuleType

from . import tensor, trace
from .api import Array
from .tensor import Tensor
from .trace import Expr, derivatives, emit, lift, variables

KINEMATICS = ("F_rr", "F_rz", "F_zr", "F_zz", "F_tt", "theta")
Values = Mapping[str, Expr]
Response = Callable[[Tensor, Expr, Values, Values, Expr], tuple[Tensor, Expr, dict[str, Expr]]]


@dataclass(frozen=True)
class Law:
    """A constitutive law.

    ``response(F, theta, state, parameters, dt)`` returns (P, q, new state): the first Piola–Kirchhoff stress P without
    the constraint pressure [Pa], the pressure-like q = ∂W/∂θ [Pa] conjugate to the independent dilatation θ, and the
    state at the end of a step of dt [s]. ``rest`` gives the state's names and values in the undeformed body.

    ``domain(p)`` says in words which condition beside their bounds the parameters violate, '' for none;
    ``stable_to(p)`` is the isochoric invariant Ĩ1 − 3 up to which the energy is strongly elliptic, inf where it
    always is. Both take the parameters as an array in the law's order.
    """

    name: str
    parameters: tuple[str, ...]
    rest: Mapping[str, float]
    response: Response
    domain: Callable[[Array], str] = lambda _: ""
    stable_to: Callable[[Array], float] = lambda _: float("inf")

    def __hash__(self) -> int:
        return hash(self.name)

    def kernels(self) -> ModuleType:
        """The compiled module: stress, stress_tangent and partials (see `_TEMPLATE`)."""
        return _load(self)


@cache
def _load(law: Law) -> ModuleType:
    key = hashlib.sha256("\0".join([law.name, *law.parameters, *_sources(law)]).encode()).hexdigest()[:16]
    path = _cache_folder() / f"law_{law.name}_{key}.py"
    if not path.exists():
        handle, scratch = tempfile.mkstemp(dir=path.parent, suffix=".part")
        with os.fdopen(handle, "w") as stream:
            stream.write(source(law))
        os.replace(scratch, path)  # another process may be doing the same: whole files only
    spec = importlib.util.spec_from_file_location(f"skinrig_solver_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)  # numba's cache looks the module up by name
    spec.loader.exec_module(module)
    return module


def _sources(law: Law) -> list[str]:
    """Whatever the generated module depends on: texts of the files behind a law's functions, or the module itself.

    The latter costs a trace; it is for functions that have no file, such as those of a notebook's cell.
    """
    try:
        own = {inspect.getfile(function) for function in _functions(law.response)}
        files = [trace.__file__, tensor.__file__, __file__, *sorted(own)]
        return [Path(file).read_text(encoding="utf-8") for file in files]
    except (OSError, TypeError):
        return [source(law)]


def _functions(response: Callable[..., object]) -> list[Callable[..., object]]:
    """A function, or those that functools.partial binds together."""
    if not isinstance(response, partial):
        return [response]
    return [f for part in (response.func, *response.args) if callable(part) for f in _functions(part)]


def _cache_folder() -> Path:
    named = os.environ.get("SKINRIG_CACHE_DIR") or os.environ.get("NUMBA_CACHE_DIR")
    if named:
        folder = Path(named)
    else:
        from platformdirs import user_cache_path  # only needed without an explicit folder

        folder = user_cache_path("skinrig-solver")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="skinrig-solver-"))  # a read-only home: compile anew in every process


_TEMPLATE = '''"""Generated from the law '{name}' by skinrig_solver.law: do not edit."""
from math import exp, expm1, log, sqrt

import numpy as np
from numba import njit

FLAGS = {{"contract", "reassoc", "arcp", "nsz"}}
ROOTS = {roots}  # columns of memory (points, ROOTS), where scalar equations start from: nan at first


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def stress(first, last, kin, state, par, dt, memory, out, new):
    """out (points, 6) = P, q; new (points, states) = state after the step."""
{stress}


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def stress_tangent(first, last, kin, state, par, dt, memory, out, tangent):
    """out (points, 6) = P, q; tangent (points, 6, 6) = their derivatives by F, theta (zeros are not written)."""
{tangent}


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def partials(first, last, kin, state, par, dt, memory, dstate, which, dstress, dnew, by_kin):
    """dstress (points, 6, m) = d(P, q) and dnew (points, states, m) = d(new state) at fixed F, theta, in the m
    directions dstate (points, states, m) and the parameter with index which (m,), −1 for none; by_kin
    (points, states, 6) = derivatives of the new state by F, theta (zeros are not written)."""
    m = which.shape[0]
    by_par = np.zeros(({rows}, {pars}))
{partials}
'''


def source(law: Law) -> str:
    """The text of the generated module."""
    kin = variables(*KINEMATICS)
    old = variables(*(f"old_{name}" for name in law.rest))
    par = variables(*(f"par_{name}" for name in law.parameters))
    (dt,) = variables("dt")
    P, q, state = law.response(
        Tensor(*kin[:5]), kin[5], dict(zip(law.rest, old, strict=True)), dict(zip(law.parameters, par, strict=True)), dt
    )
    out = [*P.components(), lift(q)]
    new = [lift(state[name]) for name in law.rest]
    shape = _Shape(kin, old, par, dt, [*out, *new])
    tangent = derivatives(out, kin)
    assign = [(f"out[g, {i}]", e) for i, e in enumerate(out)]
    return _TEMPLATE.format(
        name=law.name,
        pars=len(par),
        rows=6 + len(new),
        roots=len(shape.memory),
        stress=shape.loop([*assign, *((f"new[g, {i}]", e) for i, e in enumerate(new))]),
        tangent=shape.loop(
            [
                *assign,
                *((f"tangent[g, {i}, {kin.index(x)}]", e) for i, row in enumerate(tangent) for x, e in row.items()),
            ]
        ),
        partials=shape.directions(out, new),
    )


class _Shape:
    """Where a law's inputs lie in the arrays, and the loop over points around its straight-line code."""

    def __init__(
        self, kin: Sequence[Expr], old: Sequence[Expr], par: Sequence[Expr], dt: Expr, outputs: Sequence[Expr]
    ) -> None:
        self.memory = {e: f"memory[g, {i}]" for i, e in enumerate(trace.roots(outputs))}
        self.points = {x: f"kin[g, {i}]" for i, x in enumerate(kin)} | {x: f"state[g, {i}]" for i, x in enumerate(old)}
        self.fixed = {x: f"par[{i}]" for i, x in enumerate(par)} | {dt: "dt"}
        self.kin, self.old, self.par = list(kin), list(old), list(par)

    def _hoisted(self, wanted: Sequence[Expr]) -> tuple[list[str], dict[Expr, str]]:
        """Code for what depends on parameters and dt only, computed once before the loop."""
        fixed: set[Expr] = set()
        needed: list[Expr] = []
        for e in trace._ordered(wanted):
            if e.op == "const" or e in self.fixed or (e.args and all(a in fixed for a in e.args)):
                fixed.add(e)
            else:
                needed += [a for a in e.args if a in fixed and a.op != "const"]
        used = [x for x in self.fixed if x in fixed]
        lines = [f"{_name(x)} = {self.fixed[x]}" for x in used if self.fixed[x] != "dt"]
        code, names = emit([e for e in needed if e.op != "var"], {x: _name(x) for x in used}, "c")
        return lines + code, names

    def loop(self, targets: Sequence[tuple[str, Expr]], extra: Sequence[str] = ()) -> str:
        wanted = [e for _, e in targets]
        head, names = self._hoisted(wanted)
        used = [e for e in trace._ordered(wanted) if e in self.points]
        code, names = emit(wanted, names | {x: _name(x) for x in used}, "v", self.memory)
        body = [f"{_name(x)} = {self.points[x]}" for x in used] + code + [f"{t} = {names[e]}" for t, e in targets]
        return _indent([*head, "for g in range(first, last):", *(f"    {line}" for line in [*body, *extra])])

    def directions(self, out: Sequence[Expr], new: Sequence[Expr]) -> str:
        """Derivatives by kinematics go to ``by_kin``; those by state and parameters are applied to the directions."""
        targets, inner = [], []
        rows = derivatives([*out, *new], [*self.kin, *self.old, *self.par])
        for i, row in enumerate(rows):
            terms = []
            for x, e in row.items():
                if x in self.old:
                    n = self.old.index(x)
                    targets.append((f"j{i}_{n}", e))
                    terms.append(f"j{i}_{n} * dstate[g, {n}, k]")
                elif x in self.par:
                    targets.append((f"by_par[{i}, {self.par.index(x)}]", e))
                elif i >= len(out):
                    targets.append((f"by_kin[g, {i - len(out)}, {self.kin.index(x)}]", e))
            target = f"dstress[g, {i}, k]" if i < len(out) else f"dnew[g, {i - len(out)}, k]"
            # a loop for each row: one output and one input array, which the compiler can vectorise
            inner += ["for k in range(m):", f"    {target} = {' + '.join(terms) or '0.0'}"]
        inner += ["for k in range(m):", "    if which[k] >= 0:"]
        inner += [f"        for i in range({len(out)}):", "            dstress[g, i, k] += by_par[i, which[k]]"]
        inner += [f"        for i in range({len(new)}):"]
        inner += [f"            dnew[g, i, k] += by_par[{len(out)} + i, which[k]]"]
        return self.loop(targets, inner)


def _name(x: Expr) -> str:
    return str(x.extra)


def _indent(lines: Sequence[str]) -> str:
    return "\n".join(f"    {line}" for line in lines)
