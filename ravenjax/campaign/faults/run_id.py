"""Computes run ids: 64-bit hashes of all inputs of a run, as 16 hexadecimal digits.

The name and value of each column are hashed with a key of the campaign. The sum of these hashes is
hashed again, so the order of columns does not matter. Empty values (NaN, or an empty word) are left
out. Numbers are hashed with the finaliser of SplitMix64 (Steele, Lea, Flood, "Fast splittable
pseudorandom number generators", 2014).
"""

import hashlib
from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd
import pyarrow as pa

DIGITS = 16
"""Number of hex digits of an id."""


def compute_run_ids(
    common: str, words: Mapping[str, pd.Categorical], numbers: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Return the id of each row of a table with these columns, uint64 [rows]. common: text with
    everything that is equal in all runs and affects outcomes. words: columns of words. numbers:
    columns of numbers, at least one. Numbers are converted to float64, so that 1 equals 1.0, and
    -0.0 equals 0.0. The id of a row depends only on its content. If several rows have the same
    content, the ids of later rows also depend on the number of earlier ones.
    """
    sums = np.zeros(len(next(iter(numbers.values()))), np.uint64)
    for name, column in words.items():
        # The empty word adds 0, as if the table had no such column.
        hashes = [
            _hash_text(f"{common}/{name}/{word}") if word else np.uint64(0)
            for word in column.categories
        ]
        sums += np.array(hashes, np.uint64)[column.codes]
    for name, values in numbers.items():
        sums += _hash_numbers(values, _hash_text(f"{common}/{name}"))
    return _make_unique(mix_bits(sums))


def mix_bits(numbers: np.ndarray) -> np.ndarray:
    """Return SplitMix64's finaliser of each number, uint64; a bijection."""
    z = numbers ^ (numbers >> np.uint64(30))
    z *= np.uint64(0xBF58476D1CE4E5B9)
    z ^= z >> np.uint64(27)
    z *= np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    return z


def stream_keys(ids: np.ndarray, purpose: str) -> np.ndarray:
    """Return keys of random-number streams, uint32 [rows]: one for each run and purpose."""
    return (mix_bits(ids ^ _hash_text(purpose)) >> np.uint64(32)).astype(np.uint32)


def format_run_ids(ids: np.ndarray) -> pa.Array:
    """Return the ids as 16 hex digits each, Arrow string [rows]."""
    offsets = np.arange(len(ids) + 1, dtype=np.int32) * DIGITS
    digits = ids.astype(">u8").tobytes().hex().encode()
    return pa.StringArray.from_buffers(len(ids), pa.py_buffer(offsets), pa.py_buffer(digits))


def parse_run_ids(text: Iterable[str]) -> np.ndarray:
    """Return the ids from their hex digits, uint64 [rows]; the inverse of `format_run_ids`."""
    return np.frombuffer(bytes.fromhex("".join(text)), ">u8").astype(np.uint64)


def hash_run_ids(ids: np.ndarray) -> str:
    """Return the sha256 of the ids in their order."""
    return hashlib.sha256(ids.astype(">u8").tobytes()).hexdigest()


def _hash_text(text: str) -> np.uint64:
    # Returns the first 64 bits of the text's sha256.
    return np.uint64(int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little"))


def _hash_numbers(values: np.ndarray, column_hash: np.uint64) -> np.ndarray:
    # Returns the hash of each value, uint64 [rows]; [1] if all values are equal. The hash of NaN is
    # 0. column_hash: makes equal values of different columns differ.
    values = values[:1] if (values == values[:1]).all() else values
    # The sum is float64, and has 0.0 in place of -0.0.
    canonical = values + 0.0
    hashes = mix_bits(canonical.view(np.uint64) ^ column_hash)
    hashes[np.isnan(canonical)] = 0
    return hashes


def _make_unique(ids: np.ndarray) -> np.ndarray:
    # Returns the ids, with new ids in place of those that earlier rows already have.
    if pd.Index(ids).is_unique:
        return ids
    # Number of equal ids in earlier rows.
    repetition = pd.Series(ids).groupby(ids).cumcount().to_numpy(np.uint64)
    repeats = repetition > 0
    ids[repeats] = mix_bits(ids[repeats] ^ mix_bits(repetition[repeats]))
    return ids
