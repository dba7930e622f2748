"""A bad cable: a TCP proxy that damages the traffic, message by message, seeded, each direction by itself.

>>> with Proxy(server.entry.address, delimiter=b"\\r", seed=1) as cable:         # doctest: +SKIP
...     cable.to_host.damage = Damage(flip=0.01, repeat=0.05)
...     rig = server.bench.instrument.open_rig(replace(server.entry, address=cable.address))
"""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from collections import Counter
from dataclasses import astuple, dataclass, fields

import numpy as np

_CHUNK = 65536
_TICK = 0.05
#: Ends of messages: text dialects, COBS packets. A link without any is cut wherever its bytes arrive.
DELIMITERS = {"cutometer": b"\r", "aspiration": b"\r", "microrobot": b"\0"}


@dataclass(frozen=True)
class Damage:
    """The share (0 … 1) of messages that suffer each fault; at most one fault a message.

    ``flip`` changes one bit, ``truncate`` cuts the message anywhere (with its end), ``drop`` loses it, ``repeat`` sends
    it twice, ``swap`` sends it after the next one, ``late`` after the next ``behind`` ones, ``garbage`` puts up to 64
    random bytes before it. Raises ValueError unless the shares are from 0 to 1 together.
    """

    flip: float = 0.0
    truncate: float = 0.0
    drop: float = 0.0
    repeat: float = 0.0
    swap: float = 0.0
    late: float = 0.0
    garbage: float = 0.0
    behind: int = 5

    def __post_init__(self) -> None:
        if not (min(self.shares) >= 0 and sum(self.shares) <= 1):
            raise ValueError(f"the shares of damaged messages go from 0 to 1 altogether: {self}")

    @property
    def shares(self) -> tuple[float, ...]:
        """The shares, in the order of the fields."""
        return astuple(self)[:-1]


_FAULTS = tuple(field.name for field in fields(Damage))[:-1]


class Wire:
    """One direction. Set ``damage`` at any time; ``done`` counts damaged messages; ``mute`` lets nothing through."""

    def __init__(self, delimiter: bytes, seed: int) -> None:
        self.damage = Damage()
        self.mute = False
        self.stuck = False  # the last whole message again and again, in place of every other
        self.done: Counter[str] = Counter()
        self._delimiter = delimiter
        self._random = np.random.default_rng(seed)
        self._rest = b""
        self._last = b""
        self._held: list[tuple[int, bytes]] = []  # how many messages go first, and the message

    def pass_on(self, data: bytes) -> bytes:
        """The bytes that leave this wire for ``data`` that entered it."""
        if not self._delimiter:
            messages = [data]
        else:
            *whole, self._rest = (self._rest + data).split(self._delimiter)
            messages = [message + self._delimiter for message in whole]
        return b"".join(self._message(message) for message in messages)

    def _message(self, message: bytes) -> bytes:
        self.done["passed"] += 1
        if self.stuck and self._last:
            return self._last
        self._last = message
        if self.mute:
            return b""
        edges = np.cumsum(self.damage.shares)
        spot = int(np.searchsorted(edges, self._random.random(), side="right"))
        if spot == len(edges):
            return message + self._released()
        fault = _FAULTS[spot]
        self.done[fault] += 1
        if fault in ("swap", "late"):
            self._held.append((1 if fault == "swap" else self.damage.behind, message))
            return b""
        return self._damaged(fault, message) + self._released()

    def _damaged(self, fault: str, message: bytes) -> bytes:
        where = int(self._random.integers(len(message)))
        match fault:
            case "flip":
                bit = 1 << int(self._random.integers(8))
                return message[:where] + bytes((message[where] ^ bit,)) + message[where + 1 :]
            case "truncate":
                return message[:where]
            case "repeat":
                return message + message
            case "garbage":
                return self._random.bytes(1 + where % 64) + message
            case _:
                return b""

    def _released(self) -> bytes:
        """Held messages whose time has come, one more message having gone before them."""
        self._held = [(left - 1, message) for left, message in self._held]
        ready = b"".join(message for left, message in self._held if left <= 0)
        self._held = [(left, message) for left, message in self._held if left > 0]
        return ready


class Proxy:
    """Listens on a loopback port, ``address``, and connects each host (one at a time) to the instrument at ``target``.

    ``to_host`` and ``to_device`` are its wires. Use it as a context manager, or ``close`` it. Raises ValueError for a
    target that is no ``socket://``.
    """

    def __init__(self, target: str, delimiter: bytes = b"", seed: int = 0) -> None:
        if not target.startswith("socket://"):
            raise ValueError(f"a proxy reaches socket://host:port, not {target!r}")
        host, port = target.removeprefix("socket://").rsplit(":", 1)
        self._target = host, int(port)
        self.to_host, self.to_device = Wire(delimiter, 2 * seed), Wire(delimiter, 2 * seed + 1)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
        self._closing = False
        self._thread = threading.Thread(target=self._serve, name="proxy", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Cut the cable and stop listening. Idempotent."""
        self._closing = True
        self._thread.join()
        self._listener.close()

    def __enter__(self) -> Proxy:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _serve(self) -> None:
        while not self._closing:
            if select.select([self._listener], [], [], _TICK)[0]:
                host, _ = self._listener.accept()
                with host, contextlib.suppress(OSError), socket.create_connection(self._target, 2.0) as device:
                    for end in (host, device):
                        end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._connect(host, device)

    def _connect(self, host: socket.socket, device: socket.socket) -> None:
        """Pass on until one end closes."""
        ways = {host: (device, self.to_device), device: (host, self.to_host)}
        while not self._closing:
            for end in select.select(list(ways), [], [], _TICK)[0]:
                data = end.recv(_CHUNK)
                if not data:
                    return
                other, wire = ways[end]
                other.sendall(wire.pass_on(data))
