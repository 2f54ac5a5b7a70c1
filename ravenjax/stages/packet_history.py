"""When the newest packets were sent, a bit for each tick: what it takes to send an older one again.

Where each packet lasts a number of cycles of its own, the tick at which one was made follows from
nothing but the lengths of all that came after it. A network that delivers older packets must
therefore remember when they were sent. It does so in words of 32 bits that shift by one in each
tick. The packet after which n others were sent is the bit above the n lowest ones that are set;
sums over pairs, fours, eights and halves of a word lead to it (S. E. Anderson, Bit Twiddling Hacks:
counting bits set, in parallel; selecting the position of a bit with a given count).
"""

from __future__ import annotations

from ravenjax.numbers.lazy import jnp, lax
from ravenjax.numbers.vec import Scalar, Vec, as_int, record

WORD = 32
"""Ticks that a word remembers."""

NEVER = 2**30
"""Age in ticks of a packet that the history does not know: longer than any run."""


@record
class PacketHistory:
    """Bit b of word w tells whether a packet was sent 32 w + b ticks ago."""

    words: Vec  # uint32, the newest first


def init(ticks: int) -> PacketHistory:
    """No packet so far; it will remember the last `ticks` ticks at least."""
    return PacketHistory(Vec.full(-(-ticks // WORD), jnp.uint32(0)))


def step(history: PacketHistory, fresh: Scalar) -> PacketHistory:
    """The history after one more tick, in which a packet is sent where it is `fresh` (bool)."""
    words, entering = [], lax.convert_element_type(fresh, jnp.uint32)
    for word in history.words:
        words.append((word << _u32(1)) | entering)
        entering = word >> _u32(WORD - 1)
    return PacketHistory(Vec(words))


def age(history: PacketHistory, newer: Scalar) -> Scalar:
    """Ticks (int32) since the packet was sent after which `newer` (int32, at least 0) others
    were; NEVER: unknown.
    """
    word, first, counted, total = _u32(0), jnp.int32(NEVER), jnp.int32(0), jnp.int32(0)
    for place, candidate in enumerate(history.words):
        count = _sums(candidate)[0]
        here = (newer >= total) & (newer < total + count)
        word = jnp.where(here, candidate, word)
        first = jnp.where(here, WORD * place, first)
        counted = jnp.where(here, total, counted)
        total = total + count
    return jnp.where(first == NEVER, first, first + _position(word, newer - counted))


def sent_within(history: PacketHistory, ticks: Scalar) -> Scalar:
    """Packets (int32) that were sent in the last `ticks` (int32) ticks, the present one among
    them.
    """
    total = jnp.int32(0)
    for place, word in enumerate(history.words):
        bits = jnp.minimum(jnp.maximum(ticks - WORD * place, 0), WORD)
        lowest = (_u32(1) << lax.convert_element_type(bits & (WORD - 1), jnp.uint32)) - _u32(1)
        total = total + _sums(word & jnp.where(bits == WORD, _u32(0xFFFFFFFF), lowest))[0]
    return total


def _u32(number: int) -> Scalar:
    return jnp.uint32(number)


def _sums(word: Scalar) -> tuple[Scalar, ...]:
    """Set bits of a word, int32; and, uint32, those of its halves, eights, fours and pairs, each
    where its bits are.
    """
    pairs = word - ((word >> _u32(1)) & _u32(0x55555555))
    fours = (pairs & _u32(0x33333333)) + ((pairs >> _u32(2)) & _u32(0x33333333))
    eights = (fours + (fours >> _u32(4))) & _u32(0x0F0F0F0F)
    halves = (eights + (eights >> _u32(8))) & _u32(0x00FF00FF)
    return as_int((halves + (halves >> _u32(16))) & _u32(0xFF)), halves, eights, fours, pairs


def _position(word: Scalar, lower: Scalar) -> Scalar:
    """Index (int32) of the set bit of a word that has `lower` (int32) set bits below it."""
    _, halves, eights, fours, pairs = _sums(word)
    position = jnp.int32(0)
    for width, sums in ((16, halves), (8, eights), (4, fours), (2, pairs), (1, word)):
        shifted = sums >> lax.convert_element_type(position, jnp.uint32)
        count = as_int(shifted & _u32(2 * width - 1))
        above = lower >= count
        position = position + jnp.where(above, width, 0)
        lower = lower - jnp.where(above, count, 0)
    return position
