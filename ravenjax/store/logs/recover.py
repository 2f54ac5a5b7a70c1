"""A truncated MCAP file made whole: every complete chunk, written anew with the index that other
tools need.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from mcap.writer import Writer

from ravenjax.errors import StoreError
from ravenjax.store.files import write_aside
from ravenjax.store.logs import mcap_records


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
    parts = mcap_records.scan(path)
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
