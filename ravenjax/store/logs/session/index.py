"""The index of a recording while it is written: on disk, for MCAP's writer keeps a kilobyte of
memory for each chunk.

A recording has a chunk every few milliseconds, and an hour of them would be 300 MB of memory beside
the session.
"""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Iterator
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.writer import Writer

_KEPT = "_Writer__chunk_indices"


class _Record:
    """An entry as it stands in the file."""

    def __init__(self, content: bytes) -> None:
        self._content = content

    def write(self, stream: RecordBuilder) -> None:
        """Put it into the summary."""
        stream.write(self._content)


class SpilledIndex:
    """What stands in for the writer's list of its chunks: entries go to an unnamed file, which
    ends with the writer.
    """

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115  as long as the recording

    def append(self, entry: Any) -> None:
        """One more chunk."""
        builder = RecordBuilder()
        entry.write(builder)
        content = builder.end()
        self._file.write(struct.pack("<I", len(content)) + content)

    def __iter__(self) -> Iterator[_Record]:
        """Every entry, in order."""
        self._file.seek(0)
        while head := self._file.read(4):
            yield _Record(self._file.read(struct.unpack("<I", head)[0]))


def spill(writer: Writer) -> None:
    """Let `writer` keep its index on disk; where a later version of it keeps none under this
    name, nothing changes.
    """
    if getattr(writer, _KEPT, None) == []:
        setattr(writer, _KEPT, SpilledIndex())
