"""Stores the ticks in which packets were sent, one bit per tick, to send an old packet again.

A network fault may deliver an older packet. The tick in which that packet was sent cannot be
computed from the number of packets, because the intervals between packets vary. The history is
therefore a row of 32-bit words that shift by one bit in each tick. Bit 0 is the present tick; a set
bit is a packet. If n packets were sent after a packet, n set bits are below its bit. To find the
bit, set bits are counted in pairs, fours, eights and halves of a word (S. E. Anderson, Bit Hacks:
counting bits set, in parallel; selecting the position of a bit with a given count).
"""

from ravenjax.numbers import Scalar, Vec, as_int, clamp, jnp, lax

WORD = 32
"""Number of ticks that one word stores, one bit each."""

NEVER = 2**30
"""Age in ticks of a packet that is not in the history; longer than any run."""


def init(ticks: int) -> Vec:
    """Return an empty history of at least the last `ticks` ticks. A history consists of words
    (uint32), the newest first. Bit b of word w is set if a packet was sent 32 w + b ticks ago.
    """
    return Vec.full(-(-ticks // WORD), jnp.uint32(0))


def step(history: Vec, fresh: Scalar) -> Vec:
    """Return the history after one more tick, in which a packet is sent if `fresh` (bool)."""
    words, entering_bit = [], lax.convert_element_type(fresh, jnp.uint32)
    for word in history:
        words.append((word << _u32(1)) | entering_bit)
        # The bit that leaves a word enters the next word.
        entering_bit = word >> _u32(WORD - 1)
    return Vec(words)


def packet_age(history: Vec, newer: Scalar) -> Scalar:
    """Return the age in ticks (int32) of a packet, or NEVER if it is not in the history. newer:
    number of packets sent after this packet, int32.
    """
    # Bit b of word w is set if a packet was sent 32 w + b ticks ago. Searched: the word with the
    # packet, the age of its bit 0, and the number of packets in newer words.
    word, word_age, newer_in_words = _u32(0), jnp.int32(NEVER), jnp.int32(0)
    total = jnp.int32(0)
    for index, candidate in enumerate(history):
        count, *_ = _count_bits(candidate)
        contains_packet = (newer >= total) & (newer < total + count)
        word = jnp.where(contains_packet, candidate, word)
        word_age = jnp.where(contains_packet, WORD * index, word_age)
        newer_in_words = jnp.where(contains_packet, total, newer_in_words)
        total = total + count
    is_missing = word_age == NEVER
    age = word_age + _bit_position(word, newer - newer_in_words)
    return jnp.where(is_missing, word_age, age)


def sent_within(history: Vec, ticks: Scalar) -> Scalar:
    """Return how many packets (int32) were sent in the last `ticks` ticks, this tick included."""
    total = jnp.int32(0)
    # Bit b of word w is set if a packet was sent 32 w + b ticks ago.
    for index, word in enumerate(history):
        bits = clamp(ticks - WORD * index, 0, WORD)
        # A shift by 32 bits is not defined, so a whole word has another mask.
        mask = (_u32(1) << lax.convert_element_type(bits & (WORD - 1), jnp.uint32)) - _u32(1)
        count, *_ = _count_bits(word & jnp.where(bits == WORD, _u32(0xFFFFFFFF), mask))
        total = total + count
    return total


def _u32(number: int) -> Scalar:
    return jnp.uint32(number)


def _count_bits(word: Scalar) -> tuple[Scalar, ...]:
    """Return the number of set bits of a word (int32), and words of partial counts: the number of
    set bits in each half of the word, in each eight, each four and each pair of bits.
    """
    # A pair of bits with the value 2 a + b has a + b set bits, which is its value minus a.
    pairs = word - ((word >> _u32(1)) & _u32(0x55555555))
    fours = (pairs & _u32(0x33333333)) + ((pairs >> _u32(2)) & _u32(0x33333333))
    eights = (fours + (fours >> _u32(4))) & _u32(0x0F0F0F0F)
    halves = (eights + (eights >> _u32(8))) & _u32(0x00FF00FF)
    return as_int((halves + (halves >> _u32(16))) & _u32(0xFF)), halves, eights, fours, pairs


def _bit_position(word: Scalar, rank: Scalar) -> Scalar:
    """Return the index (int32) of the set bit with this rank (int32); the lowest set bit has 0."""
    _, halves, eights, fours, pairs = _count_bits(word)
    position = jnp.int32(0)
    # Bisection: is the bit among the lower or the upper `width` bits from `position` on? `counts`
    # has the number of set bits in each group of `width` bits, at the place of this group.
    for width, counts in ((16, halves), (8, eights), (4, fours), (2, pairs), (1, word)):
        shifted = counts >> lax.convert_element_type(position, jnp.uint32)
        count = as_int(shifted & _u32(2 * width - 1))
        is_in_upper = rank >= count
        position = position + jnp.where(is_in_upper, width, 0)
        rank = rank - jnp.where(is_in_upper, count, 0)
    return position
