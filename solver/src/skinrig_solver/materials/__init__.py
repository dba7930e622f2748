"""Constitutive laws for the axisymmetric and plane-strain problems: one file of formulas each.

A law is a :class:`skinrig_solver.law.Law`: the names of its parameters, its state at rest, and a ``response`` written
with the traced tensors of :mod:`skinrig_solver.tensor`. Stress, consistent tangent, state update and all derivatives
that the sensitivities need follow from that one function.
"""
