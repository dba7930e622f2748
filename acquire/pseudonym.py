"""Pseudonyms of subjects: one rule for the window, the command line and every program.

A pseudonym is written into recordings and, by people and tools, into names of files and columns: it must not lead to
another folder, nor look like a person's name and first name.
"""

from __future__ import annotations

import re
import secrets

LONGEST = 40
RULE = f"letters, digits, '-', '_' and '.', beginning with a letter or digit, at most {LONGEST} of them"
_ALLOWED = re.compile(rf"[^\W_][\w.-]{{0,{LONGEST - 1}}}")
_LETTERS = "23456789ABCDEFGHJKMNPQRSTVWXYZ"  # without those that are mistaken for each other


def check(text: str) -> str:
    """``text`` if it is a pseudonym or empty. Raises ValueError that says the rule."""
    if text and (not _ALLOWED.fullmatch(text) or ".." in text):
        raise ValueError(f"{text[: LONGEST + 5]!r} is no pseudonym: {RULE}")
    return text


def fresh() -> str:
    """A random one: P and four letters or digits."""
    return "P" + "".join(secrets.choice(_LETTERS) for _ in range(4))
