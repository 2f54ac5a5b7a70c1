"""Recovery of MCAP files that were cut short anywhere or damaged."""

import io

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from ravenjax.errors import StoreError
from ravenjax.store.logs import mcap_records
from ravenjax.store.logs.session import log as session_log

NAMES = ["tick", "runlevel", *(f"gold/jpos/{i}" for i in range(7))]
BLOCKS = 12
BLOCK = 20


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A recording, its bytes, and where each of its chunks ends with everything that belongs to
    it.
    """
    path = tmp_path_factory.mktemp("recover") / session_log.FILE
    rows = np.random.default_rng(2).normal(size=(BLOCKS * BLOCK, len(NAMES))).astype(np.float32)
    writer = session_log.SessionWriter(path, NAMES, {"arms": ["gold"]})
    for block in range(BLOCKS):
        part = slice(block * BLOCK, (block + 1) * BLOCK)
        writer.add(part.start, rows[part], [{"kind": "target", "tick": block}])
    writer.close()
    with open(path, "rb") as file:
        index = make_reader(file).get_summary().chunk_indexes
    ends = sorted(one.chunk_start_offset + one.chunk_length for one in index)
    return path.read_bytes(), rows, ends


def chunks(data):
    """Where chunks stand by the file's own index."""
    return sorted(
        make_reader(io.BytesIO(data)).get_summary().chunk_indexes,
        key=lambda one: one.chunk_start_offset,
    )


def seeking(path):
    """Sequence numbers of the flat messages as the library's seeking reader gives them."""
    with open(path, "rb") as file:
        return [
            one.sequence
            for _, _, one in make_reader(file).iter_messages(topics=["/ravenjax/signals"])
        ]


@pytest.mark.slow
def test_a_file_cut_anywhere_keeps_every_whole_chunk(whole, tmp_path):
    data, rows, ends = whole
    assert len(ends) == BLOCKS
    cuts = {end + more for end in ends for more in (-1, 0, 1)} | set(range(ends[0], len(data), 211))
    path, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    for cut in sorted(cut for cut in cuts if cut >= ends[0]):
        path.write_bytes(data[:cut])
        chunks = sum(end <= cut for end in ends)
        log = session_log.read_session_log(path)
        assert log.complete == (cut == len(data)), cut
        np.testing.assert_array_equal(log.rows, rows[: chunks * BLOCK])
        assert [one["tick"] for one in log.events] == list(range(chunks))
        told = mcap_records.recover_records(path, out)
        assert seeking(out) == list(range(chunks * BLOCK))
        assert (
            told.seconds == pytest.approx((chunks * BLOCK - 1) * 1e-3)
            and told.complete == log.complete
        )
        assert told.lost_bytes == log.lost_bytes <= max(np.diff([*ends, len(data)]))
        again = session_log.read_session_log(out)
        assert again.complete and again.header == log.header and again.events == log.events


def test_a_file_without_a_whole_chunk_is_refused(whole, tmp_path):
    data, _, ends = whole
    path = tmp_path / "cut.mcap"
    for cut in (8, 60, ends[0] - 1):
        path.write_bytes(data[:cut])
        with pytest.raises(StoreError, match=r"cut\.mcap: contains no complete message"):
            mcap_records.recover_records(path)
    path.write_bytes(b"plain text, not a log")
    with pytest.raises(StoreError, match="is no MCAP file"):
        mcap_records.recover_records(path)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
@pytest.mark.parametrize("cut", [False, True])
@pytest.mark.parametrize("size", [1, 300])
def test_damage_anywhere_costs_at_most_the_chunks_that_it_touches(whole, tmp_path, size, cut):
    data, rows, ends = whole
    data = data[: ends[-1]] if cut else data
    begins = [index.chunk_start_offset for index in chunks(whole[0])]
    # from the last chunk to the summary: what the session was, once more, which is looked for
    # behind whole chunks alone
    behind = 0 if cut else int.from_bytes(data[-28:-20], "little") - ends[-1]
    path = tmp_path / "damaged.mcap"
    places = {place + more for place in (*begins, *ends) for more in range(-3, 12)} | set(
        range(begins[0], len(data), 97)
    )
    for at in sorted(
        place for place in places if ends[0] <= place < ends[-1]
    ):  # the first names the channels
        path.write_bytes(
            data[:at] + bytes(byte ^ 0x5A for byte in data[at : at + size]) + data[at + size :]
        )
        hit = {k for k in range(BLOCKS) if begins[k] < at + size and at < ends[k]}
        log = session_log.read_session_log(path)
        assert set(log.numbers.tolist()) >= {
            n for n in range(BLOCKS * BLOCK) if n // BLOCK not in hit
        }, at
        np.testing.assert_array_equal(log.rows, rows[log.numbers])
        lost = sum(ends[k] - begins[k] for k in hit) + behind * (BLOCKS - 1 in hit)
        assert len(hit) <= 2 and log.lost_bytes <= lost + 2 * size + 600


@pytest.mark.parametrize("chunked", [True, False])
def test_any_mcap_file_is_recovered(tmp_path, chunked):
    path = tmp_path / "other.mcap"
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=200, compression=CompressionType.LZ4, use_chunking=chunked)
        writer.start("", "other")
        channel = writer.register_channel("/text", "json", 0, {"unit": "none"})
        for i in range(50):
            writer.add_message(channel, 1000 * i, b"{}" * 10, 1000 * i + 7, i)
        writer.finish()
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 3])
    told = mcap_records.recover_records(path)
    with open(told.path, "rb") as file:
        found = [
            (one.log_time, one.publish_time, one.data)
            for _, _, one in make_reader(file).iter_messages()
        ]
    assert 5 < len(found) < 50 and found == [
        (1000 * i, 1000 * i + 7, b"{}" * 10) for i in range(len(found))
    ]
    assert mcap_records.scan_records(told.path).channels[channel].metadata == {"unit": "none"}
