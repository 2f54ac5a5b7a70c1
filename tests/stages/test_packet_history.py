"""The history of packets against lists of the ticks at which they were sent."""

import jax.numpy as jnp
import numpy as np
from evaluated_program import in_python
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.numbers.vec import Vec
from ravenjax.stages import packet_history
from ravenjax.stages.packet_history import NEVER, WORD

WORDS = 3
TICKS = WORDS * WORD


def answers(newer, ticks, fresh, *words):
    """Age, packets in the last ticks, and the words after one more tick, of plain numbers."""
    history = Vec(words)
    after = packet_history.step(history, fresh)
    return (
        packet_history.packet_age(history, newer),
        packet_history.sent_within(history, ticks),
        *after,
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
