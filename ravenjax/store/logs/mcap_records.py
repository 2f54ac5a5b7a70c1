"""What an MCAP file holds up to where it breaks off: every complete record, and how much is missing.

The library's seeking reader needs the index at the end of a file; this one walks from the beginning, as long as records
are whole. A chunk whose content does not match its checksum is left out and counted.
"""

from __future__ import annotations

import io
import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from ravenjax.errors import StoreError

_HEAD = struct.Struct("<BQ")  # of a record: opcode, length
_MESSAGE = struct.Struct("<HIQQ")  # of a message, before its data

Bytes = bytes | mmap.mmap

Message = tuple[int, int, int, int, bytes]
"""Channel, sequence number, log time and publish time in ns, data."""


@dataclass
class Scan:
    """A file's records; the file stays mapped, so that a long one does not fill the memory."""

    data: Bytes = field(repr=False)
    profile: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: list[Channel] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    parts: list[tuple[int, int, int]] = field(default_factory=list)  # opcode, first byte, end of chunks and messages
    complete: bool = False  # the footer and the closing magic are there
    lost_bytes: int = 0  # behind the last whole record, and of damaged chunks

    def messages(self) -> Iterator[Message]:
        """Every message in the order of the file."""
        for opcode, start, end in self.parts:
            body = self.data[start:end]
            if opcode == Opcode.MESSAGE:
                yield _message(body, 0, len(body))
                continue
            records = _content(body)
            for inner, first, last in _walk(records):
                if inner == Opcode.MESSAGE:
                    yield _message(records, first, last)


def scan(path: Path) -> Scan:
    """Read a file, whole or cut short. StoreError where it cannot be read or is no MCAP file."""
    data: Bytes = b""
    try:
        with open(path, "rb") as file:
            if file.seek(0, io.SEEK_END):
                data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError as error:
        raise StoreError(f"{path}: cannot be read ({error.strerror or error})") from error
    magic = len(MCAP0_MAGIC)
    if data[:magic] != MCAP0_MAGIC:
        raise StoreError(f"{path}: is no MCAP file, it does not begin with the magic bytes; expected one, whole or cut")
    result = Scan(data)
    whole = magic
    footer = False
    for opcode, start, end in _walk(data, magic):
        _take(result, opcode, start, end)
        whole, footer = end, opcode == Opcode.FOOTER
        if footer:
            break
    result.complete = footer and data[whole : whole + magic] == MCAP0_MAGIC
    result.lost_bytes += 0 if result.complete else len(data) - whole
    return result


def _walk(data: Bytes, at: int = 0) -> Iterator[tuple[int, int, int]]:
    """Opcode, first byte and end of each whole record."""
    while at + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        start, at = at + _HEAD.size, at + _HEAD.size + length
        if at > len(data):
            return
        yield opcode, start, at


def _message(records: bytes, start: int, end: int) -> Message:
    return (*_MESSAGE.unpack_from(records, start), records[start + _MESSAGE.size : end])


def _content(body: bytes) -> bytes:
    """The records of a chunk; raises what `_damage` lists."""
    stream, length = get_chunk_data_stream(Chunk.read(ReadDataStream(io.BytesIO(body))), validate_crc=True)
    return stream.read(length)


def _damage() -> tuple[type[Exception], ...]:
    """What a damaged chunk makes the library and its decompressors raise; RuntimeError is lz4's."""
    import zstandard

    return McapError, ValueError, RuntimeError, struct.error, zstandard.ZstdError


def _take(found: Scan, opcode: int, start: int, end: int) -> None:
    if opcode == Opcode.MESSAGE:
        found.parts.append((opcode, start, end))
        return
    if opcode == Opcode.CHUNK:
        _take_chunk(found, start, end)
        return
    stream = ReadDataStream(io.BytesIO(found.data[start:end]))
    if opcode == Opcode.HEADER:
        found.profile = Header.read(stream).profile
    elif opcode == Opcode.METADATA:
        found.metadata.append(Metadata.read(stream))
    elif opcode == Opcode.ATTACHMENT:
        found.attachments.append(Attachment.read(stream))
    else:
        _take_definition(found, opcode, stream)


def _take_chunk(found: Scan, start: int, end: int) -> None:
    try:
        records = _content(found.data[start:end])
    except _damage():
        found.lost_bytes += end - start
        return
    for opcode, first, last in _walk(records):
        if opcode != Opcode.MESSAGE:
            _take_definition(found, opcode, ReadDataStream(io.BytesIO(records[first:last])))
    found.parts.append((Opcode.CHUNK, start, end))


def _take_definition(found: Scan, opcode: int, stream: ReadDataStream) -> None:
    """Schemas and channels, which the summary of a whole file repeats."""
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(stream)
        found.schemas.setdefault(schema.id, schema)
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(stream)
        if all(channel.id != one.id for one in found.channels):
            found.channels.append(channel)
