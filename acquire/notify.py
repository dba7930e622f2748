"""Telling somebody who is not looking: a command or a webhook when a run ends, trips or stalls.

A hook gets one JSON object (``notify/1``), a command on its standard input, a webhook as the body of a POST. Hooks of a
station file are used only where the operator says so (``--notify station``): a command is code, and station files come
from other people.
"""

from __future__ import annotations

import http.client
import json
import logging
import queue
import re
import shlex
import subprocess
import threading
import urllib.request
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from pydantic import field_validator, model_validator

from protocols.fields import Model, Text

log = logging.getLogger(__name__)

Event = Literal["end", "trip", "stall"]
PATIENCE = 10.0  # s of wall time that one hook may take
FAREWELL = 15.0  # s of wall time that all of them may take at the end


class Hook(Model):
    """A ``command`` (program and arguments; no shell) or a ``webhook`` (http or https), for some events or all."""

    on: tuple[Event, ...] = ("end", "trip", "stall")
    command: tuple[Text, ...] = ()
    webhook: Text = ""

    @field_validator("webhook")
    @classmethod
    def _check_webhook(cls, url: str) -> str:
        if url and not re.fullmatch(r"https?://[^\s/]+\S*", url):
            raise ValueError("a webhook begins with http:// or https://")
        return url

    @model_validator(mode="after")
    def _check(self) -> Hook:
        if bool(self.command) == bool(self.webhook):
            raise ValueError("a hook is a command or a webhook, one of them")
        return self


def hooks(said: Sequence[str], of_station: Sequence[Hook]) -> tuple[Hook, ...]:
    """Hooks as the command line says them: ``station``, a URL, or a command line. Raises ValueError."""
    found: list[Hook] = []
    for text in said:
        if text == "station":
            if not of_station:
                raise ValueError("--notify station: the station file has no 'notify'")
            found += of_station
        elif text.startswith(("http://", "https://")):
            found.append(Hook(webhook=text))
        else:
            found.append(Hook(command=tuple(shlex.split(text))))
    return tuple(found)


class Notifier:
    """Calls hooks in a thread of its own. A hook that fails, or takes too long, is logged and nothing else."""

    def __init__(self, hooks: Sequence[Hook]) -> None:
        self._hooks = tuple(hooks)
        self._waiting: queue.SimpleQueue[tuple[Hook, bytes] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def tell(self, event: Event, facts: Mapping[str, Any]) -> None:
        """Call every hook for ``event``; returns at once."""
        body = json.dumps({"schema": "notify/1", "event": event, **facts}, default=str).encode()
        for hook in self._hooks:
            if event in hook.on:
                if self._thread is None:
                    self._thread = threading.Thread(target=self._serve, name="notifier", daemon=True)
                    self._thread.start()
                self._waiting.put((hook, body))

    def close(self) -> None:
        """Wait until every message is delivered, or has had its time. Idempotent."""
        if self._thread is not None:
            self._waiting.put(None)
            self._thread.join(FAREWELL)
            self._thread = None

    def _serve(self) -> None:
        while (item := self._waiting.get()) is not None:
            hook, body = item
            try:
                _run(hook.command, body) if hook.command else _post(hook.webhook, body)
            except (OSError, ValueError, http.client.HTTPException, subprocess.SubprocessError) as error:
                log.warning("notify %s: %s", hook.webhook or hook.command[0], error)


def _run(command: Sequence[str], body: bytes) -> None:
    subprocess.run(
        command, input=body, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=PATIENCE, check=True
    )


def _post(url: str, body: bytes) -> None:
    request = urllib.request.Request(url, body, {"Content-Type": "application/json"}, method="POST")
    with urllib.request.urlopen(request, timeout=PATIENCE):
        pass
