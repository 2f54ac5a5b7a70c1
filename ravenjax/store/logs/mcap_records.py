"""Reads an MCAP file that may be truncated or damaged, and counts the lost bytes.

The seeking reader of the mcap library needs the index at the end of a file. Its other reader stops
at the first damaged byte. This module reads record by record. A record whose content does not match
its length or checksum is skipped and counted, and reading continues at the next complete chunk.

`recover_records` rewrites a truncated file with the index that other programs need.
"""

import io
import mmap
import re
import struct
import sys
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC, Writer

from ravenjax.errors import StoreError
from ravenjax.store.files import disk_errors, write_aside

_HEAD, _FOOTER = 9, 29
"""Number of bytes of a record's opcode and length, and of a whole footer."""
_RECORD, _MESSAGE = struct.Struct("<BQ"), struct.Struct("<HIQQ")
"""Layout of a record (opcode, length) and a message (channel, number, log time, publish time)."""
_CHUNK = re.compile(rb"\x06.{6}\0\0.{28}(?:\0\0\0\0|\x03\0\0\0lz4|\x04\0\0\0zstd)", re.DOTALL)
"""Pattern of the beginning of a chunk: opcode, length, times, size, checksum and compression."""


@dataclass
class Scan:
    """The records of a file. It is memory-mapped, so that a large file does not fill the memory."""

    data: mmap.mmap = field(repr=False)
    profile: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: list[Metadata] = field(default_factory=list)
    # Positions of chunks, and of messages outside chunks.
    places: list[int] = field(default_factory=list)
    complete: bool = False  # the file has a footer and the magic bytes at its end
    lost_bytes: int = 0  # number of bytes in damaged records, and after the last complete record

    def messages(self, topics: Collection[str] = ()) -> Iterator[Message]:
        """Yield the messages of these topics in order, or all messages if no such topic exists."""
        wanted = {number for number, one in self.channels.items() if one.topic in topics}
        for offset in self.places:
            record = _read_record(self.data, offset)[0]
            if isinstance(record, Chunk):
                yield from _messages_of(record, wanted)
            elif isinstance(record, Message) and (not wanted or record.channel_id in wanted):
                yield record
            if sys.platform == "linux":
                # This frees the memory of the pages that were read.
                self.data.madvise(mmap.MADV_DONTNEED)


def scan_records(path: Path) -> Scan:
    """Scan the records of a file, which may be truncated. Raise StoreError if the file cannot be
    read or is no MCAP file.
    """
    with disk_errors(f"{path}: cannot be read"), open(path, "rb") as file:
        if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise StoreError(
                f"{path}: is no MCAP file, because it does not begin with the magic bytes of MCAP."
                " Only the end of the file may be missing"
            )
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    scanned, offset, end = Scan(data), len(MCAP0_MAGIC), len(data)
    foot = end - len(MCAP0_MAGIC) - _FOOTER
    ended = data[-len(MCAP0_MAGIC) :] == MCAP0_MAGIC
    scanned.complete = foot > 0 and ended and data[foot] == Opcode.FOOTER
    summary = int.from_bytes(data[foot + _HEAD : foot + _HEAD + 8], "little")
    while offset < end:
        length = int.from_bytes(data[offset + 1 : offset + _HEAD], "little")
        entries = int.from_bytes(data[offset + _HEAD + 2 : offset + _HEAD + 6], "little")
        beyond = offset + _HEAD + length
        if data[offset] == Opcode.MESSAGE_INDEX and length == 6 + entries and beyond <= end:
            offset = beyond
            continue
        try:
            record, after = _read_record(data, offset)
            records = [record]
            if isinstance(record, Chunk):
                records = [
                    _parse(content[begin - _HEAD : last])
                    for opcode, content, begin, last in _split(record)
                    if opcode != Opcode.MESSAGE
                ]
        # The library and its decompressors raise many kinds of errors on damaged bytes.
        except Exception:
            chunk = _CHUNK.search(data, offset + 1)
            resumed = chunk.start() if chunk else end
            if chunk is None and scanned.complete and offset < summary < end:
                resumed = summary
            scanned.lost_bytes += resumed - offset
            offset = resumed
            continue
        if data[offset] in (Opcode.CHUNK, Opcode.MESSAGE):
            scanned.places.append(offset)
        for record in records:
            match record:
                case Header():
                    scanned.profile = record.profile
                case Schema():
                    scanned.schemas[record.id] = record
                case Channel():
                    scanned.channels[record.id] = record
                case Metadata():
                    scanned.metadata.append(record)
        offset = end if isinstance(record, Footer) else after
    return scanned


def _read_record(data: mmap.mmap, offset: int) -> tuple[McapRecord, int]:
    """Return the record that begins at byte `offset`, and the byte after its end. It may raise any
    kind of exception if bytes are inconsistent or have another length.
    """
    # A record is the opcode (1 byte), the length of the content (8 bytes) and the content.
    end = offset + _HEAD + int.from_bytes(data[offset + 1 : offset + _HEAD], "little")
    record = _parse(data[offset:end])
    # The library ignores surplus bytes, so the record is encoded again to compare its length.
    encoded = RecordBuilder()
    record.write(encoded)
    if len(encoded.end()) != end - offset:
        raise ValueError("the content of the record does not match its length")
    return record, end


def _parse(content: bytes) -> McapRecord:
    return next(StreamReader(io.BytesIO(content), skip_magic=True, emit_chunks=True).records)


def _split(chunk: Chunk) -> Iterator[tuple[int, bytes, int, int]]:
    """Yield (opcode, bytes of the chunk, begin and end of the content) of each record in a chunk.
    It may raise any kind of exception if the chunk is damaged.
    """
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    content, offset = stream.read(size), 0
    while offset < size:
        opcode, length = _RECORD.unpack_from(content, offset)
        begin = offset + _HEAD
        offset = begin + length
        yield opcode, content, begin, offset


def _messages_of(chunk: Chunk, wanted: Collection[int]) -> Iterator[Message]:
    """Yield the messages of a chunk on the channels `wanted` (ids; empty: all channels). This is
    ten times as fast as the mcap library.
    """
    for opcode, content, begin, end in _split(chunk):
        if opcode == Opcode.MESSAGE:
            channel, number, log_ns, publish_ns = _MESSAGE.unpack_from(content, begin)
            if not wanted or channel in wanted:
                data = content[begin + _MESSAGE.size : end]
                yield Message(channel, log_ns, data, publish_ns, number)


class Recovered(NamedTuple):
    """Result of the recovery of a damaged file."""

    path: Path  # path of the new file
    messages: int
    seconds: float  # time from the first message to the last
    # Number of bytes of the old file after its last complete record, or in damaged chunks.
    lost_bytes: int
    complete: bool  # True if the old file was complete

    def __str__(self) -> str:
        """Return a sentence for the command line."""
        if self.complete and not self.lost_bytes:
            return f"{self.path}: {self.seconds:.3f} s, {self.messages} messages; nothing was lost"
        return (
            f"{self.path}: {self.seconds:.3f} s recovered, {self.messages} messages; "
            f"{self.lost_bytes} bytes of incomplete or damaged chunks are lost"
        )


def recovered_path(path: Path) -> Path:
    """Return the default path of a recovered file: session.mcap -> session.recovered.mcap."""
    return path.with_name(f"{path.stem}.recovered{path.suffix}")


def recover_records(path: Path, out: Path | None = None) -> Recovered:
    """Write the complete records of the MCAP file `path` to `out`; None: `recovered_path`. Messages
    keep their order, times and numbers. If `out` is `path`, the file is replaced atomically. Raise
    StoreError if reading or writing fails, or if no message is complete.
    """
    out = recovered_path(path) if out is None else out
    scanned = scan_records(path)
    if next(scanned.messages(), None) is None:
        raise StoreError(
            f"{path}: contains no complete message, but {scanned.lost_bytes} bytes of an"
            " incomplete chunk; nothing can be recovered"
        )
    if not scanned.channels:
        raise StoreError(
            f"{path}: the list of channels is damaged, at the beginning of the file and in its"
            " index; nothing can be recovered"
        )
    times = []

    def fill(target: Path):
        # Writes all readable messages to a new file with the same topics.
        with open(target, "wb") as file:
            writer = Writer(file)
            writer.start(profile=scanned.profile, library="ravenjax")
            for metadata in scanned.metadata:
                writer.add_metadata(metadata.name, metadata.metadata)
            schemas = {0: 0} | {
                number: writer.register_schema(schema.name, schema.encoding, schema.data)
                for number, schema in sorted(scanned.schemas.items())
            }
            channels = {
                number: writer.register_channel(
                    one.topic, one.message_encoding, schemas.get(one.schema_id, 0), one.metadata
                )
                for number, one in scanned.channels.items()
            }
            for record in scanned.messages():
                # The chunk that defined the channel may be damaged.
                channel = channels.get(record.channel_id)
                if channel is not None:
                    writer.add_message(
                        channel, record.log_time, record.data, record.publish_time, record.sequence
                    )
                    times.append(record.log_time)
            writer.finish()

    write_aside(out, fill)
    seconds = (max(times, default=0) - min(times, default=0)) * 1e-9
    return Recovered(out, len(times), seconds, scanned.lost_bytes, scanned.complete)
