"""Constitutive laws: each is one file with an energy and one compiled function for everything derived from it.

``point(C, p, derivatives, S, D, dS)`` writes, for one right Cauchy-Green tensor ``C`` (6,), the second Piola-Kirchhoff
stress ``S`` (6,) = 2 dW/dC, the tangent ``D`` (6, 6) = dS/dE and, where ``derivatives`` is true, ``dS`` (m, 6) = dS/dp.
Where the law has no value (a locked chain, say) it writes NaN and the caller cuts its step. Conventions: tensors.py.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numba import boolean, cfunc, float64, types

from ..api import Parameter
from .tensors import Array

SIGNATURE = types.void(float64[::1], float64[::1], boolean, float64[::1], float64[:, ::1], float64[:, ::1])
FUNCTION = types.FunctionType(SIGNATURE)  # lets one compiled kernel serve every law, and be cached on disk


def compiled(function: Callable[..., None]) -> Any:
    """Compile a law's ``point`` to the common signature; the machine code is cached on disk."""
    return cfunc(SIGNATURE, cache=True, error_model="numpy")(function)


@dataclass(frozen=True)
class Law:
    """A hyperelastic law W(C; p) + U(J), stress-free at C = I.

    Attributes
    ----------
    name, source : str
    parameters : the law's own parameters, in the order of ``p``; the bulk modulus is the last
    energy : ``energy(C, p)`` [J/m^3], compiled
    point : see the module's docstring
    prestress : (sx, sy) [Pa] identified together with the default parameters
    aligned : x, y and z are axes of material symmetry, so a response is known from one octant of directions
    domain : the condition on the parameters, beside their bounds, without which there is no stress even at rest
    """

    name: str
    parameters: tuple[Parameter, ...]
    energy: Callable[[Array, Array], float]
    point: Any
    source: str
    prestress: tuple[float, float]
    aligned: bool = True
    domain: str = ""

    @property
    def symbols(self) -> tuple[str, ...]:
        return tuple(p.symbol for p in self.parameters)


BULK = Parameter("bulk", "Pa", 1e4, 1e8, 1e6, "bulk modulus B of U(J) = B/2 (ln J)^2", "M", "log")
