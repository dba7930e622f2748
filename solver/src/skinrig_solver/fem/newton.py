"""Which tangent Newton's method takes next, and when it has converged: told by the sizes of its corrections."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

MAX_NEWTON = 14  # tangents in a step
OLD = 0.1  # of the tolerance: the share accepted after a correction with an old tangent, which no square makes smaller
CHEAP = 3  # iterations that an old tangent may still need: three cost about as much as a new one
CONTRACTION = 0.1  # of successive corrections with an old tangent, as long as none has been seen
NEAR = 1e-2  # of the length scale: a step that is expected to move the body less begins with the last one's tangent
TOLERANCE = 1e-6  # error accepted after a step, relative to the length scale: last correction times its contraction


@dataclass
class Newton:
    """One step's iterations; ``reuse``: a tangent that is there already may serve.

    ``renew`` says whether the next iteration needs a tangent of its own.
    """

    scale: float
    reuse: bool
    iterations: int = 0
    tangents: int = 0
    renew: bool = field(init=False)
    best: float = field(init=False, default=inf)
    previous: float = field(init=False, default=inf)

    def __post_init__(self) -> None:
        self.renew = not self.reuse

    def begins(self) -> bool:
        """Count an iteration; false where there have been too many tangents."""
        if self.tangents >= MAX_NEWTON:
            return False
        self.iterations += 1
        self.tangents += self.renew
        return True

    def diverges(self, size: float) -> bool:
        return self.tangents > 6 and size > 2.0 * self.best

    def strays(self, size: float) -> bool:
        """Whether an old tangent leads astray: the step must begin anew with tangents of its own."""
        if self.renew or size <= min(self.previous, NEAR * self.scale):
            return False
        self.reuse, self.renew, self.previous = False, True, inf
        return True

    def share(self, size: float) -> float:
        """Of a correction: far from the solution a full one may fold elements, so that no node moves beyond half the
        length scale."""
        return min(1.0, 0.5 * self.scale / size) if size > 0 else 1.0

    def converges(self, size: float) -> bool:
        """Whether a correction of that size was the last; else ``renew`` is set for the next one."""
        seen = min(1.0, size / self.previous)
        # one small correction may be chance where tangents serve twice: none counts as contracting better
        left = size * (max(seen, CONTRACTION) if self.reuse else seen or 1.0)
        if left <= TOLERANCE * self.scale * (1.0 if self.renew else OLD):
            return True
        self.best, self.previous = min(self.best, size), size
        expected = seen if 0.0 < seen < 1.0 else CONTRACTION
        self.renew = not self.reuse or size * expected**CHEAP > TOLERANCE * self.scale
        return False
