"""The history of packets against lists of the ticks at which they were sent."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from compiled_program import compiled, lowered, same_bits
from evaluated_program import in_python
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.numbers.vec import Vec
from ravenjax.stages import packet_history
from ravenjax.stages.packet_history import NEVER, WORD, PacketHistory

WORDS = 3
TICKS = WORDS * WORD


def answers(newer, ticks, fresh, *words):
    """Age, packets in the last ticks, and the words after one more tick, of plain numbers."""
    after = packet_history.step(PacketHistory(Vec(words)), fresh)
    history = PacketHistory(Vec(words))
    return (
        packet_history.age(history, newer),
        packet_history.sent_within(history, ticks),
        *after.words,
    )


KINDS = (jnp.int32(0), jnp.int32(0), jnp.bool_(False), *(jnp.uint32(0) for _ in range(WORDS)))
PLAIN = in_python(answers, *KINDS)


def packed(sent) -> list[int]:
    """Words of a history whose tick i ago had a packet where sent[i]."""
    bits = np.array(sent, np.uint64).reshape(WORDS, WORD)
    return [int((word << np.arange(WORD, dtype=np.uint64)).sum()) for word in bits]


def expected_age(sent, newer: int) -> int:
    ages = np.flatnonzero(sent)
    return int(ages[newer]) if newer < len(ages) else NEVER


histories = st.lists(st.booleans(), min_size=TICKS, max_size=TICKS)


@given(histories, st.integers(0, TICKS + 5), st.integers(0, TICKS + 40), st.booleans())
def test_ages_and_counts_are_those_of_the_list(sent, newer, ticks, fresh):
    age, within, *words = PLAIN((newer, ticks, fresh, *packed(sent)))
    assert age == expected_age(sent, newer)
    assert within == sum(sent[:ticks])
    assert words == packed([fresh, *sent[:-1]])


@given(histories)
def test_what_is_that_old_is_the_first_packet_that_is_not_within(sent):
    """Of any age, the packet that came after all those within it is the youngest that is no
    younger.
    """
    for ticks in range(0, TICKS, 7):
        within = PLAIN((0, ticks, False, *packed(sent)))[1]
        age = PLAIN((within, 0, False, *packed(sent)))[0]
        assert age == next((i for i in range(ticks, TICKS) if sent[i]), NEVER)


def test_engines_have_the_same_bits():
    rng = np.random.default_rng(5)
    size = 2000
    density = rng.random((size, 1, 1))
    bits = rng.random((size, WORDS, WORD)) < density
    words = (
        (bits.astype(np.uint64) << np.arange(WORD, dtype=np.uint64)).sum(axis=2).astype(np.uint32)
    )
    words[:3] = 0, 0xFFFFFFFF, 0x80000001
    columns = (
        rng.integers(0, TICKS, size).astype(np.int32),
        rng.integers(0, TICKS + 2, size).astype(np.int32),
        rng.random(size) < 0.5,
        *(np.ascontiguousarray(words[:, i]) for i in range(WORDS)),
    )
    ours = compiled(lowered(answers, *columns), 16, columns)
    for got, right in zip(ours, jax.jit(jax.vmap(answers))(*columns), strict=True):
        same_bits(got, np.asarray(right))
    for row in range(0, size, 50):
        plain = PLAIN([column[row] for column in columns])
        assert [int(column[row]) for column in ours] == [int(x) for x in plain]
