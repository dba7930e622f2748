"""Second-order tensors with the symmetry of an axisymmetric body (or of plane strain), over traced expressions.

Components are ordered rr, rz, zr, zz, tt (t the hoop direction); a symmetric tensor keeps rr, rz, zz, tt.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from .trace import Expr, Number, lift, power


@dataclass(frozen=True)
class Sym:
    """A symmetric tensor."""

    rr: Expr
    rz: Expr
    zz: Expr
    tt: Expr

    def components(self) -> tuple[Expr, ...]:
        return _components(self)

    def __add__(self, other: Sym) -> Sym:
        return Sym(self.rr + other.rr, self.rz + other.rz, self.zz + other.zz, self.tt + other.tt)

    def __sub__(self, other: Sym) -> Sym:
        return Sym(self.rr - other.rr, self.rz - other.rz, self.zz - other.zz, self.tt - other.tt)

    def __mul__(self, factor: Number) -> Sym:
        return Sym(self.rr * factor, self.rz * factor, self.zz * factor, self.tt * factor)

    __rmul__ = __mul__

    def trace(self) -> Expr:
        return self.rr + self.zz + self.tt

    def det(self) -> Expr:
        return (self.rr * self.zz - self.rz * self.rz) * self.tt

    def dev(self) -> Sym:
        return self - identity() * (self.trace() / 3.0)

    def inner(self, other: Sym) -> Expr:
        """Double contraction."""
        return self.rr * other.rr + self.zz * other.zz + self.tt * other.tt + 2.0 * (self.rz * other.rz)

    def square(self, metric: Sym) -> Expr:
        """tr (S M S M): the squared norm of S as the metric M measures it."""
        rr, rz = self.rr * metric.rr + self.rz * metric.rz, self.rr * metric.rz + self.rz * metric.zz
        zr, zz = self.rz * metric.rr + self.zz * metric.rz, self.rz * metric.rz + self.zz * metric.zz
        tt = self.tt * metric.tt
        return rr * rr + zz * zz + tt * tt + 2.0 * (rz * zr)

    def inverse(self) -> Sym:
        plane = self.rr * self.zz - self.rz * self.rz
        return Sym(self.zz / plane, -(self.rz / plane), self.rr / plane, 1.0 / self.tt)


@dataclass(frozen=True)
class Tensor:
    """A general tensor, such as a deformation gradient or a first Piola–Kirchhoff stress."""

    rr: Expr
    rz: Expr
    zr: Expr
    zz: Expr
    tt: Expr

    def components(self) -> tuple[Expr, ...]:
        return _components(self)

    def __mul__(self, factor: Number) -> Tensor:
        return Tensor(*(c * factor for c in self.components()))

    def det(self) -> Expr:
        return (self.rr * self.zz - self.rz * self.zr) * self.tt

    def unimodular(self) -> Tensor:
        """Scaled to determinant one."""
        return self * power(self.det(), -1.0 / 3.0)

    def inverse(self) -> Tensor:
        plane = self.rr * self.zz - self.rz * self.zr
        return Tensor(self.zz / plane, -(self.rz / plane), -(self.zr / plane), self.rr / plane, 1.0 / self.tt)

    def push(self, a: Sym) -> Sym:
        """F A Fᵀ."""
        rr, rz = self.rr * a.rr + self.rz * a.rz, self.rr * a.rz + self.rz * a.zz
        zr, zz = self.zr * a.rr + self.zz * a.rz, self.zr * a.rz + self.zz * a.zz
        return Sym(
            rr * self.rr + rz * self.rz,
            rr * self.zr + rz * self.zz,
            zr * self.zr + zz * self.zz,
            self.tt * self.tt * a.tt,
        )

    def right_cauchy_green(self) -> Sym:
        """FᵀF."""
        return Sym(
            self.rr * self.rr + self.zr * self.zr,
            self.rr * self.rz + self.zr * self.zz,
            self.rz * self.rz + self.zz * self.zz,
            self.tt * self.tt,
        )

    def times(self, a: Sym) -> Tensor:
        """F A: the first Piola–Kirchhoff stress of a second one."""
        return Tensor(
            self.rr * a.rr + self.rz * a.rz,
            self.rr * a.rz + self.rz * a.zz,
            self.zr * a.rr + self.zz * a.rz,
            self.zr * a.rz + self.zz * a.zz,
            self.tt * a.tt,
        )

    def piola(self, tau: Sym) -> Tensor:
        """τ F⁻ᵀ: the first Piola–Kirchhoff stress of a Kirchhoff stress."""
        g = self.inverse()
        return Tensor(
            tau.rr * g.rr + tau.rz * g.rz,
            tau.rr * g.zr + tau.rz * g.zz,
            tau.rz * g.rr + tau.zz * g.rz,
            tau.rz * g.zr + tau.zz * g.zz,
            tau.tt * g.tt,
        )


def identity() -> Sym:
    one, zero = lift(1.0), lift(0.0)
    return Sym(one, zero, one, one)


def _components(tensor: Sym | Tensor) -> tuple[Expr, ...]:
    return tuple(getattr(tensor, f.name) for f in fields(tensor))
