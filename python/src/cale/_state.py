"""Saved environments as bytes."""

from __future__ import annotations

import struct
import zlib

_MAGIC = b"cale state 1\n"


def pack(states: list[bytes]) -> bytes:
    """Returns the states of environments as one."""
    parts = b"".join(struct.pack("<Q", len(state)) + state for state in states)
    return _MAGIC + zlib.compress(parts, 1)


def unpack(state: bytes) -> list[bytes]:
    """Returns what was given to `pack`. Throws ValueError for bytes that it did not return."""
    if not isinstance(state, (bytes, bytearray)) or not state.startswith(_MAGIC):
        raise ValueError("this is no state that save() returned")
    try:
        parts = zlib.decompress(state[len(_MAGIC):])
    except zlib.error:
        raise ValueError("the saved state is cut off or damaged") from None
    states, at = [], 0
    while at < len(parts):
        size = int.from_bytes(parts[at:at + 8], "little")
        if at + 8 + size > len(parts):
            raise ValueError("the saved state is cut off or damaged")
        states.append(parts[at + 8:at + 8 + size])
        at += 8 + size
    return states
