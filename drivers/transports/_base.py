"""The operations of every link, and exact reads on top of it."""

from __future__ import annotations

import abc
import time

from drivers.claims import Claim
from drivers.device import LinkLost
from drivers.transports._addresses import without_token


class Transport(abc.ABC):
    """An open byte link, owned by one thread. Every method but `close` raises LinkLost once the link is gone."""

    def __init__(self, address: str) -> None:
        self.address = without_token(address)
        self.claim: Claim | None = None
        self._kept = bytearray()

    @abc.abstractmethod
    def _receive(self, timeout: float) -> bytes:
        """Bytes that have arrived, or arrive within ``timeout`` s; empty when nothing does."""

    @abc.abstractmethod
    def write(self, data: bytes) -> None:
        """Send all of ``data``. A link that takes none of it for a second is lost."""

    @abc.abstractmethod
    def close(self) -> None:
        """Close the link and `_release` the claim on it. Idempotent, never raises."""

    def _release(self) -> None:
        if self.claim is not None:
            self.claim.release()

    def read(self, timeout: float) -> bytes:
        """Bytes that have arrived, waiting at most ``timeout`` s of wall time for the first byte; empty when nothing
        came."""
        if self._kept:
            data = bytes(self._kept)
            self._kept.clear()
            return data
        return self._receive(timeout)

    def read_exactly(self, count: int, timeout: float) -> bytes | None:
        """Exactly ``count`` bytes, or None when they are not complete after ``timeout`` s; then none is lost.

        A short read is continued until the deadline, so that the sender may cut its bytes as it likes.
        """
        deadline = time.monotonic() + timeout
        while len(self._kept) < count:
            data = self._receive(max(0.0, deadline - time.monotonic()))
            self._kept += data
            if not data and time.monotonic() >= deadline:
                return None
        exact = bytes(self._kept[:count])
        del self._kept[:count]
        return exact

    def _lost(self, cause: object) -> LinkLost:
        return LinkLost(f"link {self.address}: {cause}")
