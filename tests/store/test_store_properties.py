"""A result folder under any history: parts added, ends without a word, damage, more rows asked
for. One table.
"""

import shutil
import tempfile
from pathlib import Path
from typing import Any

import made_up_rows
import pytest
import synthetic_results as synthetic
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from ravenjax.errors import StoreError
from ravenjax.store import manifest as manifests
from ravenjax.store import parts, schema
from ravenjax.store.folder import ResultFolder, read_all

RUNS = 24
SHAPE = schema.Shape(joints=("shoulder",), cues=1, checks=(), parameters=("p",))
FRAME = made_up_rows.frame(SHAPE, RUNS)
OTHER = made_up_rows.frame(SHAPE, RUNS, seed=1)
spans = st.tuples(st.integers(0, RUNS - 1), st.integers(0, RUNS - 1)).map(sorted).map(tuple)


def wanted(rows=None, **changes):
    return synthetic.manifest(RUNS, shape=SHAPE, cues=(), detectors=(), rows=rows, **changes)


class Histories(RuleBasedStateMachine):
    """What a folder may live through. `asked` is which rows it is to hold by now."""

    @initialize()
    def begin(self):
        self.path = Path(tempfile.mkdtemp()) / "results"
        self.folder: Any = None  # a ResultFolder while it is open
        self.asked: set[int] = set()

    def teardown(self):
        if hasattr(self, "path"):
            self._complete()
            shutil.rmtree(self.path.parent)

    def _complete(self):
        """The same command again, without any accident."""
        folder = ResultFolder.open(self.path, wanted())
        for span in folder.missing(7):
            folder.add(FRAME.iloc[span.start : span.stop])
        folder.close(1.0, 1.0, 1)
        assert read_all(self.path).equals(expected())
        record = manifests.read_manifest(self.path)
        assert record.finished is not None and record.done == RUNS
        assert sorted(row for part in record.parts for row in part.rows) == list(range(RUNS)), (
            "none twice, none lost"
        )
        assert not list((self.path / "parts").glob(".*")), "nothing half written stays"

    # --- what a campaign does

    @precondition(lambda self: self.folder is None)
    @rule(rows=st.one_of(st.none(), st.lists(spans, min_size=1, max_size=2)))
    def start(self, rows):
        """Open it, for all rows or for some more of them."""
        if rows is None:
            self.asked = set(range(RUNS))
        else:
            rows = manifests.join_ranges(tuple(rows))
            # A start that stored nothing does not decide what the folder is for.
            kept = self.asked if self._parts() else set()
            self.asked = kept | {row for first, last in rows for row in range(first, last + 1)}
        self.folder = ResultFolder.open(self.path, wanted(rows))
        assert {row for span in self.folder.manifest.wanted for row in span} == self.asked

    @precondition(lambda self: self.folder is not None)
    @rule(chunk=st.integers(1, 9), which=st.integers(0, 30))
    def add(self, chunk, which):
        """Finish one of the chunks that are missing, in any order."""
        if missing := list(self.folder.missing(chunk)):
            span = missing[which % len(missing)]
            self.folder.add(FRAME.iloc[span.start : span.stop])

    @precondition(lambda self: self.folder is not None)
    @rule()
    def close(self):
        """End in good order."""
        self.folder.close(1.0, 1.0, 1)
        whole = not list(self.folder.missing(RUNS))
        assert (manifests.read_manifest(self.path).finished is not None) == whole
        self.folder = None

    # --- what happens to it

    @precondition(lambda self: self.folder is not None)
    @rule(torn=st.integers(0, 200), half=st.booleans())
    def crash(self, torn, half):
        """End without a word; the last lines of the list may be lost with what the disk had not
        written.
        """
        listed = self.path / manifests.PARTS_FILE
        content = listed.read_bytes() if listed.exists() else b""
        listed.write_bytes(content[: max(0, len(content) - torn)])
        if half:
            (self.path / "parts" / ".part-000000003-000000005.parquet.tmp").write_bytes(
                b"PAR1 half written"
            )
        self.folder = None

    @precondition(lambda self: self.folder is None and self._parts())
    @rule(
        which=st.integers(0, 30),
        how=st.sampled_from(["flip", "cut", "empty", "lose"]),
        at=st.floats(0, 0.999),
    )
    def damage(self, which, how, at):
        """A part is changed or lost between two starts."""
        path = self._parts()[which % len(self._parts())]
        content = path.read_bytes()
        place = int(at * len(content))
        if how == "lose":
            path.unlink()
        elif content:
            flipped = content[:place] + bytes([content[place] ^ 0x40]) + content[place + 1 :]
            path.write_bytes({"flip": flipped, "cut": content[:place], "empty": b""}[how])

    @precondition(lambda self: self.folder is None and self._known())
    @rule(span=spans, foreign=st.booleans())
    def intrude(self, span, foreign):
        """A part that another campaign, or another start of this one, left behind."""
        frame, of = (OTHER, "another campaign") if foreign else (FRAME, wanted().config_hash)
        synthetic.write_part(self.path / "parts", frame.iloc[span[0] : span[1] + 1], SHAPE, of)

    @precondition(lambda self: self.folder is None and self._known() and self._parts())
    @rule()
    def another_campaign(self):
        """A start with another config changes nothing."""
        before = self._content()
        with pytest.raises(
            StoreError, match=r"contains .* of 24 runs of campaign 'synthetic', which differs"
        ):
            ResultFolder.open(self.path, wanted(config={"name": "another"}, config_hash="0" * 64))
        assert self._content() == before

    @invariant()
    def the_parts_that_count_are_apart_and_whole(self):
        if getattr(self, "folder", None) is not None:
            held = sorted(row for part in self.folder.manifest.parts for row in part.rows)
            missing = sorted(row for span in self.folder.missing(5) for row in span)
            assert len(set(held)) == len(held) and set(held) | set(missing) >= self.asked
            assert not set(held) & set(missing)
            assert self.folder.manifest.done == len(held)

    def _parts(self):
        return parts.part_files(self.path / "parts")

    def _known(self):
        return (self.path / manifests.FILE).exists()

    def _content(self):
        return {path: path.read_bytes() for path in sorted(self.path.rglob("*")) if path.is_file()}


def expected():
    """The table of a folder without a history."""
    return parts.concatenate_parts([schema.conform_table(FRAME, SHAPE)])


TestHistories = pytest.mark.slow(Histories.TestCase)
TestHistories.settings = settings(max_examples=6, stateful_step_count=12, deadline=None)
