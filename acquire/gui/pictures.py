"""Pictures inlined in a report's HTML page."""

from __future__ import annotations

import base64
import binascii
from html.parser import HTMLParser

KINDS = ("data:image/png;base64", "data:image/svg+xml;base64")


def pictures(page: str) -> list[bytes]:
    """The pictures (PNG or SVG) inlined in an HTML page, in its order; those elsewhere, or broken, are left out."""
    reader = _Pictures()
    reader.feed(page)
    reader.close()
    return reader.found


class _Pictures(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[bytes] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag != "img":
            return
        kind, _, coded = (dict(attrs).get("src") or "").partition(",")
        if kind not in KINDS:
            return
        try:
            self.found.append(base64.b64decode(coded, validate=True))
        except binascii.Error:
            return
