"""Merges the shards of a campaign into one result folder, as if one machine had computed all runs.

Files are hard-linked if the file system allows this, else copied. Each file is checked before and
after. The manifest is written last. The target folder counts as one more shard, so the same command
can be repeated after an interruption, or with further shards.
"""

import os
import shutil
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from ravenjax import threads
from ravenjax.engines import selection
from ravenjax.errors import StoreError, list_lines
from ravenjax.store import manifest as manifests
from ravenjax.store import parts
from ravenjax.store.access import lock, query
from ravenjax.store.files import hash_file, path_inside, require_writable, write_aside
from ravenjax.store.folder import PARTS, READERS
from ravenjax.store.manifest import Manifest
from ravenjax.store.parts import Part


class Merged(NamedTuple):
    """Result of a merge."""

    manifest: Manifest  # manifest of the merged folder
    linked: int  # number of files that are hard links
    copied: int
    present: int  # number of files that were in the target folder before
    missing: list[range]  # rows that no shard contains


class PartSource(NamedTuple):
    """A part and its folder."""

    folder: Path  # the shard
    part: Part

    @property
    def file(self) -> Path:
        """Path of the part."""
        return self.folder / PARTS / self.part.file


def merge_shards(out: Path, shards: Sequence[Path], partial: bool = False) -> Merged:
    """Join the result folders `shards` into the folder `out`. partial: permit missing rows. All
    shards must have the same campaign, engine, code and package versions. They are not changed.
    Raise StoreError, before anything is written, if they differ, a file is damaged, two files
    contain the same row, or rows are missing.
    """
    folders = _folders(out, shards)
    records = {folder: manifests.read_manifest(folder) for folder in folders}
    first = folders[0]
    for folder in folders[1:]:
        _require_same(first, folder, records)
    sources = _disjoint([part for folder in folders for part in _parts(folder, records[folder])])
    wanted = range(records[first].runs)
    missing = list(parts.missing_rows([source.part for source in sources], [wanted]))
    if missing and not partial:
        raise StoreError(_incomplete(records, missing))
    require_writable(path_inside(out, PARTS))
    with lock.hold_lock(out):
        _require_own(out, sources)
        done = [_link_or_copy(source, out, records[first].config_hash) for source in sources]
        record = _joined(list(records.values()), sources, bool(missing))
        manifests.write_manifest(out, record)
    return Merged(record, done.count("linked"), done.count("copied"), done.count("kept"), missing)


def _folders(out: Path, shards: Sequence[Path]) -> list[Path]:
    # Returns the folders to merge, each once: the output folder if it has results, and the shards.
    if not shards:
        raise StoreError(
            f"{out}: got no shards to merge; on the command line, write the result folders of the"
            " shards after the output folder"
        )
    earlier = [out] if (out / manifests.FILE).exists() else []
    by_location = {folder.resolve(): folder for folder in shards}
    by_location.pop(out.resolve(), None)
    return [*earlier, *by_location.values()]


def _require_same(first: Path, other: Path, manifest_of: Mapping[Path, Manifest]):
    # Refuses the folder `other` if it is no shard of the campaign in `first`.
    here, there = manifest_of[first], manifest_of[other]
    # Shards may differ in their number, and in the device if the engine computes the same on all.
    engine = selection.ENGINES.get(here.engine)
    portable = engine is not None and engine.portable
    allowed = {"shard": here.shard} | ({"device": here.device} if portable else {})
    differences = here.differences(there.model_copy(update=allowed), "there")
    if here.runs != there.runs:
        differences.append(f"runs: {here.runs} here, {there.runs} there")
    if differences:
        lines = list_lines(differences)
        raise StoreError(
            f"{other}: is no shard of the campaign in {first}. 'Here' is {first}, 'there' is"
            f" {other}:\n{lines}\nNothing was merged. Compute all shards with the same code and the"
            " same command, except for --shard and --out."
        )


def _parts(folder: Path, record: Manifest) -> list[PartSource]:
    """Return the complete files of a shard. A complete file may lack a record if the power failed
    before it was recorded.
    """
    recorded = {part.file: part for part in record.parts}
    names = {*recorded, *(path.name for path in parts.part_files(folder / PARTS))}

    def checked(name: str) -> PartSource:
        path, part = folder / PARTS / name, recorded.get(name)
        return PartSource(folder, parts.verify_part(path, record.config_hash, part))

    return threads.map_in_threads(checked, sorted(names), READERS)


def _disjoint(sources: list[PartSource]) -> list[PartSource]:
    """Return the files in the order of rows, with equal files of several shards once. Raise
    StoreError if two different files contain the same row.
    """
    by_content: dict[tuple[int, int, str], PartSource] = {}
    for source in sources:
        by_content.setdefault((source.part.first, source.part.last, source.part.sha256), source)
    ordered = sorted(by_content.values(), key=lambda source: source.part.first)
    for one, other in pairwise(ordered):
        if other.part.first <= one.part.last:
            both = range(other.part.first, min(one.part.last, other.part.last) + 1)
            raise StoreError(
                f"{one.file} and {other.file} contain row {query.in_words([both])}. Nothing was"
                " merged. If both files contain exactly the same rows, delete one of the files."
                " Otherwise, merge without one of the two shards."
            )
    return ordered


def _incomplete(records: dict[Path, Manifest], missing: list[range]) -> str:
    # Returns the message about rows that no shard contains. records: manifests by folder.
    rows = sum(map(len, missing))
    sentences = [
        f"the campaign has {next(iter(records.values())).runs:,} runs, but {rows:,} of these are in"
        f" no shard: rows {query.in_words(missing)}."
    ]
    for folder, record in records.items():
        lacking = list(parts.missing_rows(record.parts, record.wanted))
        if record.rows is not None and lacking:
            ranges = query.in_words(lacking)
            sentences.append(f"{folder} lacks rows {ranges}: start its command again.")
    sentences.append("Nothing was merged: name all shards, or permit missing rows with --partial.")
    return " ".join(sentences)


def _link_or_copy(source: PartSource, out: Path, config_hash: str) -> str:
    # Links a file into the merged folder, which needs no disk space, or else copies the file.
    # Returns what was done: "linked", "copied", or "kept" if the file was there before.
    merged = out / PARTS / source.part.file
    part = source.part
    if merged.exists() and (merged.samefile(source.file) or hash_file(merged) == part.sha256):
        return "kept"

    def fill(aside: Path):
        # Creates a part in the output folder as a link if possible, otherwise as a copy.
        try:
            os.link(source.file.resolve(), aside)
        # The folders are on different file systems, or the file system has no links.
        except OSError:
            shutil.copyfile(source.file, aside)

    write_aside(merged, fill)
    if merged.samefile(source.file):
        return "linked"
    parts.verify_part(merged, config_hash, part)
    return "copied"


def _require_own(out: Path, sources: list[PartSource]):
    # Raises StoreError if the output folder contains parts that do not belong to the merged result.
    names = {source.part.file for source in sources}
    foreign = [path for path in parts.part_files(out / PARTS) if path.name not in names]
    if foreign:
        raise StoreError(
            f"{foreign[0]}: this file of the output folder is in none of the shards. Nothing was"
            " merged: name another output folder, or delete this file."
        )


def _joined(records: list[Manifest], sources: list[PartSource], incomplete: bool) -> Manifest:
    # Returns the manifest of the merged folder: the first of `records`, except for these values.
    ends = [record.finished for record in records if record.finished]
    finished = None if incomplete else max(ends, default=manifests.utc_now())
    seconds = [record.run_s for record in records if record.run_s]
    return records[0].model_copy(
        update={
            "rows": None,
            "shard": None,
            "parts": tuple(source.part for source in sources),
            "notices": tuple(dict.fromkeys(note for record in records for note in record.notices)),
            "device": "; ".join(dict.fromkeys(record.device for record in records)),
            "started": min(record.started for record in records),
            "finished": finished,
            # Shards may run at the same time, so their times do not add up to a speed.
            "starts": max(record.starts for record in records),
            "run_s": sum(seconds) if seconds else None,
            "runs_per_s": None,
        }
    )
