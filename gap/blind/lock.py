"""Keeping the key of a blind check unreadable: a stream cipher with authentication from the standard library.

HMAC-SHA256 in counter mode as the stream, HMAC-SHA256 over the whole as the seal, both keyed from the passphrase by
scrypt. It keeps labels from being read by accident or by a program; it is not meant against an adversary with time.
"""

from __future__ import annotations

import hashlib
import hmac
import os

_MAGIC = b"blind-key/1\n"
_DEFAULT = "unread, not secret"  # where no passphrase is given


def _keys(passphrase: str, salt: bytes) -> tuple[bytes, bytes]:
    both = hashlib.scrypt((passphrase or _DEFAULT).encode(), salt=salt, n=2**12, r=8, p=1, dklen=64)
    return both[:32], both[32:]


def _stream(key: bytes, data: bytes) -> bytes:
    blocks = -(-len(data) // 32)
    pad = b"".join(hmac.digest(key, i.to_bytes(8, "big"), "sha256") for i in range(blocks))[: len(data)]
    return (int.from_bytes(data, "big") ^ int.from_bytes(pad, "big")).to_bytes(len(data), "big")


def seal(data: bytes, passphrase: str) -> bytes:
    """Encrypt and authenticate ``data``."""
    salt = os.urandom(16)
    cipher, mac = _keys(passphrase, salt)
    body = _MAGIC + salt + _stream(cipher, data)
    return body + hmac.digest(mac, body, "sha256")


def unseal(blob: bytes, passphrase: str) -> bytes:
    """Inverse of ``seal``. Raises ValueError for another passphrase, a damaged file, or a file of another kind."""
    if not blob.startswith(_MAGIC) or len(blob) < len(_MAGIC) + 48:
        raise ValueError("not a key file of a blind check")
    body, tag = blob[:-32], blob[-32:]
    salt = body[len(_MAGIC) : len(_MAGIC) + 16]
    cipher, mac = _keys(passphrase, salt)
    if not hmac.compare_digest(tag, hmac.digest(mac, body, "sha256")):
        raise ValueError("wrong passphrase, or the key file is damaged")
    return _stream(cipher, body[len(_MAGIC) + 16 :])
