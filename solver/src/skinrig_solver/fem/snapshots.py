"""Fields of a body at chosen times of a run: displacement and, where asked for, stress, stretch and history."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from ..api import Array, Field
from ..nodal import Split, quantities, six
from .body import Body
from .mesh import Mesh
from .types import State


class Marching(Protocol):
    """As much of a run as its fields need."""

    body: Body
    state: State
    steps: int


class Snapshots:
    """Collects the steps from which fields at ``times`` [s] follow, by the interpolation that channels have too.

    ``weights`` (len(times), 1 + steps) holds the weight of the first state and of every step. ``visit`` is called with
    the first state and after every step. ``whole`` adds stress, stretch and history to the displacement.
    """

    def __init__(self, run: Marching, times: Sequence[float], weights: sp.csr_matrix, whole: bool) -> None:
        self.run, self.times, self.weights, self.whole = run, tuple(times), weights, whole
        self._needed = frozenset(weights.indices[weights.data != 0.0].tolist())
        self._kept: dict[int, tuple[Array, Array]] = {}
        self._count = 0
        self._moved = run.steps > 0  # a preload came before
        self.visit()

    def visit(self) -> None:
        """Keep the run's present state if a field needs it."""
        if self._count in self._needed:
            self._kept[self._count] = self._present()
        self._count += 1
        self._moved = True

    def _present(self) -> tuple[Array, Array]:
        """Displacement (k, 2), and F, Cauchy stress and history (k, 15 + states) at the nodes."""
        body, state = self.run.body, self.run.state
        split = _split(body.mesh)
        points = _at_points(body, state, self._moved) if self.whole else np.empty((len(state.history), 0))
        return state.u[split.source], split.at_nodes(points) if self.whole else points

    def fields(self) -> tuple[Field, ...]:
        """One field a time, in their order."""
        body = self.run.body
        mesh, split = body.mesh, _split(body.mesh)
        found = []
        for time, row in zip(self.times, self.weights, strict=True):
            parts = [(w, self._kept[k]) for k, w in zip(row.indices.tolist(), row.data, strict=True) if w != 0.0]
            moved, nodal = (np.sum([w * part[i] for w, part in parts], axis=0) for i in (0, 1))
            values = {}
            if self.whole:
                history = {f"history_{n}": c for n, c in zip(body.law.rest, nodal[:, 15:].T, strict=True)}
                values = quantities(nodal[:, :9], nodal[:, 9:15]) | history
            found.append(
                Field(mesh.nodes[split.source], moved, split.cells, mesh.layer, mesh.layer_names, time, values)
            )
        return tuple(found)


@lru_cache(maxsize=8)
def _split_of(elements: bytes, layer: bytes) -> Split:
    return Split.of(np.frombuffer(elements, dtype=np.int64).reshape(-1, 9), np.frombuffer(layer, dtype=np.int64))


def _split(mesh: Mesh) -> Split:
    return _split_of(mesh.elements.astype(np.int64).tobytes(), mesh.layer.astype(np.int64).tobytes())


def _at_points(body: Body, state: State, moved: bool) -> Array:
    """F (9), Cauchy stress (6) and history at the Gauss points of the state that was solved last: (points, …).

    The body's workspaces still hold its F and its stress without the constraint pressure.
    """
    count = len(state.history)
    F, P = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    places = ([0, 0, 1, 1, 2], [0, 1, 0, 1, 2])  # rr, rz, zr, zz, tt
    if moved:
        F[:, *places], P[:, *places] = body.kin[:, :5], body.stress[:, :5]
    else:
        F[:] = np.eye(3)
    J = np.linalg.det(F)
    constraint = (state.p @ body.mesh.points.linear.T).ravel()
    cauchy = P @ F.transpose(0, 2, 1) / J[:, None, None] + constraint[:, None, None] * np.eye(3)
    return np.concatenate([F.reshape(count, 9), six(cauchy), state.history], axis=1)
