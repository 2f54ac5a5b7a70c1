"""Console profiles: files and their errors; packets under the right profile, a wrong one, and
one that is found.
"""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ravenjax.errors import UserError
from ravenjax.robots.raven2.console.choice import ProfileChoice
from ravenjax.robots.raven2.console.profile import ConsoleProfile
from ravenjax.robots.raven2.console.reading import FIELDS, Misfit, PacketReader, PacketReading
from ravenjax.store import consoles

BOTH = ("gold", "green")
LEVEL = (0.0, 0.0, 0.0, 1.0)


def fields(number=1, gold=(0, 0, 0), quat=LEVEL, jaw=0, button=0, mode=1):
    """A packet in which gold moves, with the right checksum."""
    values = [number, 0, 0]
    values += [x for c in gold for x in (c, 0)] + [
        x for c, level in zip(quat, LEVEL, strict=True) for x in (c, level)
    ]
    values += [button, 0, jaw, 0, mode]
    return (*values, number + sum(gold) + button + mode)


def profile(**tables):
    return ConsoleProfile.model_validate({"name": "own", "title": "t", "source": "s", **tables})


def fed(reader, packets):
    """Every packet read as the next of the stream."""
    results = []
    for packet in packets:
        results.append(reader.read(packet))
        if isinstance(results[-1], PacketReading):
            reader.accept_packet()
    return results


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('jaw.form = "positions"', "jaw: form = 'positions' needs the range"),
        (
            "largest.step_um = 5000.0",
            r"largest\.step_um: got 5000.0, expected less than or equal to 1000",
        ),
        ("[", "not a TOML file"),
    ],
)
def test_errors_of_a_file(tmp_path, text, words):
    path = tmp_path / "own.toml"
    path.write_text('name = "own"\ntitle = "t"\nsource = "s"\n' + text)
    with pytest.raises(UserError, match=words) as caught:
        consoles.load_profile(str(path))
    assert str(path) in str(caught.value)


def test_an_orientation_is_taken_from_packet_to_packet():
    own = profile(orientation={"form": "quaternion"})
    turns = [Rotation.from_rotvec([0.3, 0.01 * n, -0.02 * n]) for n in range(5)]
    results = fed(
        PacketReader(own, ("gold",)),
        [fields(n + 1, quat=tuple(t.as_quat())) for n, t in enumerate(turns)],
    )
    assert results[0].quat[0] == LEVEL, "where the hand began moves nothing"
    steps = [Rotation.from_quat(result.quat[0]) for result in results[1:]]
    made = turns[0]
    for step in steps:
        made = step * made
    np.testing.assert_allclose(made.as_matrix(), turns[-1].as_matrix(), atol=1e-12)


def test_a_jaw_position_moves_by_its_change_and_never_by_what_was_lost():
    reader = PacketReader(consoles.load_profile("dv_trainer"), ("gold",))
    packets = [
        fields(n, jaw=jaw, button=jaw) for n, jaw in enumerate((1200, 1230, 1200, 1381), start=1)
    ]
    assert [getattr(r, "grasp_mrad", r) for r in fed(reader, packets[:3])] == [(0,), (30,), (-30,)]
    jump = reader.read(packets[3])
    assert isinstance(jump, Misfit) and (jump.cause, jump.got) == ("grasp", "181 mrad")
    assert reader.read(packets[3], is_next=False) == reader.read(fields(9), is_next=False)
    reader.accept_packet()
    far = reader.read(fields(9, jaw=3201, button=3201), is_next=False)
    assert str(far) == "grasp of gold: got 3201 mrad, expected a position in -200..3200 mrad"


NUMBERS = st.floats() | st.sampled_from([0.0, 1.0, -1.0, 2.0, math.nan, math.inf, 1e200])
INTS = st.integers(-(2**31), 2**31 - 1) | st.integers(-300, 300)


@given(
    st.sampled_from(["raven", "dv_trainer", "auto"]),
    st.lists(
        st.tuples(
            st.lists(INTS, min_size=3, max_size=3), st.tuples(*[NUMBERS] * 4), INTS, st.booleans()
        ),
        max_size=8,
    ),
)
def test_whatever_comes_only_small_increments_are_read(name, hostile):
    choice = ProfileChoice(consoles.profile_choices(name), ("gold",))
    for n, (gold, quat, jaw, again) in enumerate(hostile, start=1):
        result = choice.read(fields(n, gold, quat, jaw, jaw if again else 0))
        if isinstance(result, PacketReading):
            choice.accept_packet()
            assert math.hypot(*result.delta_um[0]) <= 1000.0
            assert abs(math.hypot(*result.quat[0]) - 1.0) < 0.011
            assert (
                2 * math.acos(min(abs(result.quat[0][3]) / math.hypot(*result.quat[0]), 1.0))
                < 0.1 + 1e-9
            )
            assert abs(result.grasp_mrad[0]) <= 200


@pytest.fixture(scope="module")
def recorded(shared_data):
    packets = pd.read_parquet(shared_data("console_itp_packets.parquet"))["packet"]
    return [FIELDS.unpack(packet) for packet in packets]


def test_the_held_out_half_is_read_as_it_was_sent(recorded):
    """The profile's bounds come from the first half; the oracle for sums is NumPy's."""
    held_out = recorded[len(recorded) // 2 :]
    results = fed(PacketReader(consoles.load_profile("dv_trainer"), BOTH), held_out)
    assert all(isinstance(result, PacketReading) for result in results)
    sent = np.array(held_out)
    moved = np.sum([result.delta_um for result in results], axis=0)
    np.testing.assert_array_equal(moved, sent[:, 3:9].sum(axis=0).reshape(3, 2).T)
    closed = np.sum([result.grasp_mrad for result in results], axis=0)
    np.testing.assert_array_equal(closed, sent[-1, 19:21] - sent[0, 19:21])
    for arm in (0, 1):
        turns = Rotation.from_quat([result.quat[arm] for result in results])
        np.testing.assert_allclose(
            turns.as_rotvec() * 1e3, sent[:, [9 + arm, 11 + arm, 13 + arm]], atol=1e-9
        )


@pytest.mark.parametrize("arms", [BOTH, ("gold",), ("green",)])
@pytest.mark.parametrize("half", [0, 1])
def test_auto_finds_the_recorded_console_early(recorded, arms, half):
    packets = recorded[half * len(recorded) // 2 :][: len(recorded) // 2]
    choice, lost = ProfileChoice(consoles.profile_choices("auto"), arms), 0
    for packet in packets:
        lost += isinstance(choice.read(packet), Misfit)
        choice.accept_packet()
    assert choice.profile == consoles.load_profile("dv_trainer")
    assert lost < 0.02 * len(packets)
