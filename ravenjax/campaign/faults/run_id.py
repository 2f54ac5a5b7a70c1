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
    """Return the id of each row of a table with these columns, uint64 [rows].

    common: text with everything that is equal in all runs and affects outcomes. words: columns of
    words. numbers: columns of numbers, at least one. Numbers are converted to float64, so that 1
    equals 1.0, and -0.0 equals 0.0. The id of a row depends only on its content. If several rows
    have the same content, the ids of later rows also depend on the number of earlier ones.
    """
    sums = np.zeros(len(next(iter(numbers.values()))), np.uint64)
    for name, column in words.items():
        keys = (word and f"{common}/{name}/{word}" for word in column.categories)
        hashes = [_salt(key) if key else np.uint64(0) for key in keys]
        sums += np.array(hashes, np.uint64)[column.codes]
    for name, values in numbers.items():
        sums += _hashed(values, _salt(f"{common}/{name}"))
    return _number_copies(mix_bits(sums))


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
    return (mix_bits(ids ^ _salt(purpose)) >> np.uint64(32)).astype(np.uint32)


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


def _salt(text: str) -> np.uint64:
    return np.uint64(int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little"))


def _hashed(values: np.ndarray, salt: np.uint64) -> np.ndarray:
    """Return the hash of each value, uint64 [rows]; [1] if all values are equal; 0 for NaN."""
    values = values[:1] if (values == values[:1]).all() else values
    canonical = values + 0.0  # float64 without -0.0
    hashes = mix_bits(canonical.view(np.uint64) ^ salt)
    hashes[np.isnan(canonical)] = 0
    return hashes


def _number_copies(ids: np.ndarray) -> np.ndarray:
    """Return the ids, with a different id in place of each repeated id."""
    if pd.Index(ids).is_unique:
        return ids
    copy = pd.Series(ids).groupby(ids).cumcount().to_numpy(np.uint64)
    further = copy > 0
    ids[further] = mix_bits(ids[further] ^ mix_bits(copy[further]))
    return ids
