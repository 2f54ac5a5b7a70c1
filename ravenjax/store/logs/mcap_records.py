"""What an MCAP file holds, whole, cut short or damaged: every complete record, and how much is
missing.

The library's seeking reader needs the index at the end of a file, and its other one ends at the
first damaged byte; this one walks from the beginning. A chunk whose content does not match its
checksum is left out and counted. Where the chain of records breaks, for a length may be what is
damaged, it goes on at the next chunk that is whole.

`recover` writes a truncated file anew, with the index that other tools need.
"""

from __future__ import annotations

import io
import mmap
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC, Writer

from ravenjax.errors import StoreError
from ravenjax.store.files import write_aside

_HEAD = struct.Struct("<BQ")  # of a record: opcode, length
_FOOTER = struct.Struct("<QQI")  # where the summary begins, its offsets, checksum
_INDEX = struct.Struct(
    "<HI"
)  # of a message index, before its entries of 16 bytes: channel, bytes of the entries
_CHUNK = re.compile(rb"\x06.{6}\0\0.{28}(?:\0\0\0\0|\x03\0\0\0lz4|\x04\0\0\0zstd)", re.DOTALL)
"""A chunk's opcode, length, times, size, checksum and compression."""
_ANY_MESSAGE = re.compile(rb"\x05.{6}\0\0", re.DOTALL)
_MESSAGE = struct.Struct("<HIQQ")  # of a message, before its data
_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}
_OPCODES = frozenset(int(opcode) for opcode in Opcode)

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
    parts: list[tuple[int, int, int]] = field(
        default_factory=list
    )  # opcode, first byte, end of chunks and messages
    complete: bool = False  # the footer and the closing magic are there
    lost_bytes: int = 0  # of no whole record: of damaged ones, and behind the last

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
        raise StoreError(
            f"{path}: is no MCAP file, it does not begin with the magic bytes; expected one, whole"
            " or cut"
        )
    result = Scan(data)
    foot = len(data) - magic - _HEAD.size - _FOOTER.size
    result.complete = foot >= magic and data[-magic:] == MCAP0_MAGIC and data[foot] == Opcode.FOOTER
    if not result.complete:
        result.lost_bytes = _take_all(result, magic, len(data))
        return result
    summary, _, _ = _FOOTER.unpack_from(data, foot + _HEAD.size)
    summary = summary if magic <= summary <= foot else foot
    result.lost_bytes = _take_all(result, magic, summary)
    _take_all(
        result, summary, foot
    )  # what the summary repeats is missed only where the data are damaged, too
    return result


def _take_all(found: Scan, at: int, until: int) -> int:
    """Take every whole record of these bytes; how many bytes are of none.

    What is no record that holds together is passed over where another follows it. Elsewhere its
    length may be what is damaged, and the search goes on right behind its first byte.
    """
    lost = 0
    while at < until:
        record = _record(found.data, at, until)
        if record is not None and _take(found, *record):
            at = record[2]
            continue
        end = until if record is None else record[2]
        if record is None or not _holds(found, end, until):
            end = _next(found, at + 1, until)
        lost += end - at
        at = end
    return lost


def _record(data: Bytes, at: int, until: int) -> tuple[int, int, int] | None:
    """Opcode, first byte and end of the record that begins here; None where it would not end in
    time.
    """
    if at + _HEAD.size > until:
        return None
    opcode, length = _HEAD.unpack_from(data, at)
    start = at + _HEAD.size
    return (opcode, start, start + length) if start + length <= until else None


def _holds(found: Scan, at: int, until: int) -> bool:
    """Whether the data end here, or a record begins that holds together."""
    record = _record(found.data, at, until)
    return at == until or (
        record is not None and _take(Scan(found.data, channels=found.channels), *record)
    )


def _next(found: Scan, at: int, until: int) -> int:
    """Where the next whole chunk begins, in a file without chunks the next message; `until`
    where there is none.
    """
    chunked = not found.parts or any(opcode == Opcode.CHUNK for opcode, _, _ in found.parts)
    look = _CHUNK if chunked else _ANY_MESSAGE
    while (match := look.search(found.data, at, until)) is not None:
        if _holds(found, match.start(), until):
            return match.start()
        at = match.start() + 1
    return until


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
    stream, length = get_chunk_data_stream(
        Chunk.read(ReadDataStream(io.BytesIO(body))), validate_crc=True
    )
    return stream.read(length)


def _damage() -> tuple[type[Exception], ...]:
    """What a damaged chunk makes the library and its decompressors raise; RuntimeError is lz4's."""
    import zstandard

    return McapError, ValueError, RuntimeError, struct.error, zstandard.ZstdError


def _take(found: Scan, opcode: int, start: int, end: int) -> bool:
    """Take a record; False where its bytes do not hold together, or it is of no kind that is
    known.
    """
    if opcode == Opcode.CHUNK:
        return _take_chunk(found, start, end)
    if opcode == Opcode.MESSAGE:
        return _take_message(found, start, end)
    if opcode == Opcode.MESSAGE_INDEX:
        return (
            end - start >= _INDEX.size
            and _INDEX.unpack_from(found.data, start)[1] == end - start - _INDEX.size
        )
    kind = _KINDS.get(opcode)
    if kind is None:
        return False
    stream = ReadDataStream(io.BytesIO(found.data[start:end]))
    try:
        record = kind.read(stream)
    except _damage():
        return False
    if stream.count != end - start:
        return False
    if isinstance(record, Header):
        found.profile = record.profile
    elif isinstance(record, Metadata):
        found.metadata.append(record)
    elif isinstance(record, Attachment):
        found.attachments.append(record)
    else:
        _take_definition(found, record)
    return True


def _take_message(found: Scan, start: int, end: int) -> bool:
    """A message beside the chunks: nothing proves it but that its channel is known and a record
    follows.
    """
    if end - start < _MESSAGE.size:
        return False
    channel = _MESSAGE.unpack_from(found.data, start)[0]
    if all(channel != one.id for one in found.channels):
        return False
    if end < len(found.data) and found.data[end] not in _OPCODES:
        return False
    found.parts.append((Opcode.MESSAGE, start, end))
    return True


def _take_chunk(found: Scan, start: int, end: int) -> bool:
    try:
        records = _content(found.data[start:end])
        inside = list(_walk(records))
        for opcode, first, last in inside:
            if opcode != Opcode.MESSAGE and (kind := _KINDS.get(opcode)) is not None:
                _take_definition(found, kind.read(ReadDataStream(io.BytesIO(records[first:last]))))
    except _damage():
        return False
    if (inside[-1][2] if inside else 0) != len(records):
        return False
    found.parts.append((Opcode.CHUNK, start, end))
    return True


def _take_definition(found: Scan, record: Any) -> None:
    """Schemas and channels, which the summary of a whole file repeats."""
    if isinstance(record, Schema):
        found.schemas.setdefault(record.id, record)
    elif isinstance(record, Channel) and all(record.id != one.id for one in found.channels):
        found.channels.append(record)


class Recovered(NamedTuple):
    """What was saved of a file."""

    path: Path  # of the new file
    messages: int
    seconds: float  # from the first message to the last
    lost_bytes: int  # of the old file, behind its last whole record or in damaged chunks
    complete: bool  # the old file was whole: nothing was missing

    def __str__(self) -> str:
        """In words, for the command line."""
        if self.complete and not self.lost_bytes:
            return (
                f"{self.path}: {self.seconds:.3f} s, {self.messages} messages; the file was whole"
            )
        return (
            f"{self.path}: {self.seconds:.3f} s recovered, {self.messages} messages; "
            f"{self.lost_bytes} bytes of an unfinished or damaged chunk are lost"
        )


def recovered_path(path: Path) -> Path:
    """Where `recover` writes unless told: session.mcap -> session.recovered.mcap."""
    return path.with_name(f"{path.stem}.recovered{path.suffix}")


def recover(path: Path, out: Path | None = None) -> Recovered:
    """Write what is whole of the MCAP file `path` to `out`, which is `recovered_path` if left out;
    any MCAP file.

    Messages keep their order, times and numbers. `out` may be `path` itself: it is replaced in one
    step. Raises StoreError where the file cannot be read, holds no whole message, or the disk
    refuses.
    """
    path = Path(path)
    out = recovered_path(path) if out is None else Path(out)
    parts = scan(path)
    if next(parts.messages(), None) is None:
        raise StoreError(
            f"{path}: holds no whole message, {parts.lost_bytes} bytes of an unfinished chunk;"
            " nothing can be recovered"
        )
    if not parts.channels:
        raise StoreError(
            f"{path}: the chunk that names its channels is damaged, and so is the index that"
            " repeats them; nothing can be recovered"
        )
    times: list[int] = []

    def fill(target: Path) -> None:
        with open(target, "wb") as file:
            writer = Writer(file)
            writer.start(profile=parts.profile, library="ravenjax")
            for metadata in parts.metadata:
                writer.add_metadata(metadata.name, metadata.metadata)
            schemas = {0: 0} | {
                number: writer.register_schema(schema.name, schema.encoding, schema.data)
                for number, schema in sorted(parts.schemas.items())
            }
            channels = {
                one.id: writer.register_channel(
                    one.topic, one.message_encoding, schemas.get(one.schema_id, 0), one.metadata
                )
                for one in parts.channels
            }
            for channel, number, log_time, publish_time, data in parts.messages():
                if channel in channels:  # not where the chunk that defined it is damaged
                    writer.add_message(channels[channel], log_time, data, publish_time, number)
                    times.append(log_time)
            for one in parts.attachments:
                writer.add_attachment(
                    one.create_time, one.log_time, one.name, one.media_type, one.data
                )
            writer.finish()

    write_aside(out, fill)
    seconds = (max(times, default=0) - min(times, default=0)) * 1e-9
    return Recovered(out, len(times), seconds, parts.lost_bytes, parts.complete)
