"""Finds joint records in bytes."""

from __future__ import annotations

import json
import zlib
from typing import Any

import numpy as np

from ravenjax.train.robot_link.joints.record import (
    CRC,
    HEAD,
    LONGEST,
    MAGIC,
    RECORD,
    TEXT_MAGIC,
    VERSION,
    JointReport,
)


class Decoder:
    """Finds whole records in a stream of bytes that may begin, break or be damaged anywhere."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.skipped = 0  # bytes that belonged to no whole record

    def feed(self, content: bytes) -> list[JointReport | dict[str, Any]]:
        """What these bytes complete, in their order: joint reports, and text records as dicts."""
        self._bytes += content
        records: list[JointReport | dict[str, Any]] = []
        data, at = self._bytes, 0
        while True:
            begin = self._next_magic(at)
            self.skipped += begin - at
            at = begin
            if len(data) - at < HEAD.size:
                break
            magic, version, size = HEAD.unpack_from(data, at)
            whole = (
                HEAD.size + CRC.size <= size <= LONGEST
                if magic == TEXT_MAGIC
                else size == RECORD.itemsize
            )
            if version != VERSION or not whole:
                at, self.skipped = at + 1, self.skipped + 1
                continue
            if len(data) - at < size:
                break
            content = bytes(data[at : at + size])
            decoded = _decoded(magic, content)
            if decoded is None:
                at, self.skipped = at + 1, self.skipped + 1
            else:
                at += size
                records.append(decoded)
        del data[:at]
        return records

    def _next_magic(self, at: int) -> int:
        """Where the next record may begin: a magic, or the tail that may become one."""
        places = [
            place for place in (self._bytes.find(m, at) for m in (MAGIC, TEXT_MAGIC)) if place >= 0
        ]
        if places:
            return min(places)
        end = len(self._bytes)
        for begin in range(max(at, end - len(MAGIC) + 1), end):
            tail = bytes(self._bytes[begin:])
            if MAGIC.startswith(tail) or TEXT_MAGIC.startswith(tail):
                return begin
        return end


def _decoded(magic: bytes, content: bytes) -> JointReport | dict[str, Any] | None:
    if zlib.crc32(content[: -CRC.size]) != CRC.unpack_from(content, len(content) - CRC.size)[0]:
        return None
    if magic == MAGIC:
        return JointReport(np.frombuffer(content, RECORD)[0])
    try:
        record = json.loads(content[HEAD.size : -CRC.size])
    except (ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) else None
