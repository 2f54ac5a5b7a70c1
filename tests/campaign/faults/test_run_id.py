"""The hash behind run ids; what counts in an id is said by `test_design_oracle`."""

import numpy as np

from ravenjax.campaign.faults import run_id


def test_the_hash_of_a_number_is_that_of_splitmix64():
    """The generator's first outputs from seed 0, as its authors' reference implementation prints
    them.
    """
    states = np.arange(1, 4, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    assert [hex(x) for x in run_id.mix_bits(states)] == [
        "0xe220a8397b1dcdaf",
        "0x6e789e6aa1b965f4",
        "0x6c45d188009454f",
    ]


def test_streams_of_two_purposes_are_strangers():
    ids = run_id.mix_bits(np.arange(1, 4097, dtype=np.uint64))
    one, other = run_id.stream_keys(ids, "slot 0"), run_id.stream_keys(ids, "slot 1")
    assert one.dtype == np.uint32 and not (one == other).any()
    ones = np.unpackbits((one ^ other).view(np.uint8)).mean()
    assert abs(ones - 0.5) < 0.01, "5 standard deviations of a fair coin are 0.007"
