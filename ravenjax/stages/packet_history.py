"""Stores the ticks in which packets were sent, one bit per tick, so that an older packet can be
sent again.

A network fault may deliver an older packet. The tick in which that packet was sent cannot be
computed from the number of packets, because the intervals between packets vary. The history is
therefore a row of 32-bit words that shift by one bit in each tick. The packet after which n others
were sent is the set bit that has n set bits below it. This bit is found by sums over pairs, fours,
eights and halves of a word (S. E. Anderson, Bit Twiddling Hacks: counting bits set, in parallel;
selecting the position of a bit with a given count).
"""

from ravenjax.numbers import Scalar, Vec, as_int, jnp, lax

WORD = 32
"""Number of ticks that one word stores, one bit each."""

NEVER = 2**30
"""Age in ticks of a packet that is not in the history; longer than any run."""


def init(ticks: int) -> Vec:
    """Return an empty history of at least the last `ticks` ticks.

    A history consists of words (uint32), the newest first. Bit b of word w is set if a packet was
    sent 32 w + b ticks ago.
    """
    return Vec.full(-(-ticks // WORD), jnp.uint32(0))


def step(history: Vec, fresh: Scalar) -> Vec:
    """Return the history after one more tick, in which a packet is sent if `fresh` (bool)."""
    words, entering = [], lax.convert_element_type(fresh, jnp.uint32)
    for word in history:
        words.append((word << _u32(1)) | entering)
        entering = word >> _u32(WORD - 1)
    return Vec(words)


def packet_age(history: Vec, newer: Scalar) -> Scalar:
    """Return the age in ticks (int32) of a packet, or NEVER if it is not in the history.

    newer: number of packets sent after this packet, int32.
    """
    word, first_age, before, total = _u32(0), jnp.int32(NEVER), jnp.int32(0), jnp.int32(0)
    for place, candidate in enumerate(history):
        count = _sums(candidate)[0]
        is_here = (newer >= total) & (newer < total + count)
        word = jnp.where(is_here, candidate, word)
        first_age = jnp.where(is_here, WORD * place, first_age)
        before = jnp.where(is_here, total, before)
        total = total + count
    return jnp.where(first_age == NEVER, first_age, first_age + _position(word, newer - before))


def sent_within(history: Vec, ticks: Scalar) -> Scalar:
    """Return the number of packets (int32) sent in the last `ticks` (int32), this one included."""
    total = jnp.int32(0)
    for place, word in enumerate(history):
        bits = jnp.minimum(jnp.maximum(ticks - WORD * place, 0), WORD)
        mask = (_u32(1) << lax.convert_element_type(bits & (WORD - 1), jnp.uint32)) - _u32(1)
        total = total + _sums(word & jnp.where(bits == WORD, _u32(0xFFFFFFFF), mask))[0]
    return total


def _u32(number: int) -> Scalar:
    return jnp.uint32(number)


def _sums(word: Scalar) -> tuple[Scalar, ...]:
    """Return the number of set bits (int32), and of those in halves, eights, fours and pairs."""
    pairs = word - ((word >> _u32(1)) & _u32(0x55555555))
    fours = (pairs & _u32(0x33333333)) + ((pairs >> _u32(2)) & _u32(0x33333333))
    eights = (fours + (fours >> _u32(4))) & _u32(0x0F0F0F0F)
    halves = (eights + (eights >> _u32(8))) & _u32(0x00FF00FF)
    return as_int((halves + (halves >> _u32(16))) & _u32(0xFF)), halves, eights, fours, pairs


def _position(word: Scalar, lower: Scalar) -> Scalar:
    """Return the index (int32) of the set bit below which `lower` (int32) bits are set."""
    _, halves, eights, fours, pairs = _sums(word)
    position = jnp.int32(0)
    for width, sums in ((16, halves), (8, eights), (4, fours), (2, pairs), (1, word)):
        shifted = sums >> lax.convert_element_type(position, jnp.uint32)
        count = as_int(shifted & _u32(2 * width - 1))
        above = lower >= count
        position = position + jnp.where(above, width, 0)
        lower = lower - jnp.where(above, count, 0)
    return position
