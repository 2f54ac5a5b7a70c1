"""The reacting operator: when the action begins, and what the hands then do."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.console import reaction
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.vocabulary.reactions import ACTIONS

SETUP = RavenSetup(precision=REFERENCE, stages=("reaction",))


@pytest.fixture(autouse=True)
def x64():
    with jax.enable_x64(True):
        yield


def params(action, **changes):
    return replace(reaction.ReactionParams(), action=jnp.int32(ACTIONS.index(action)), **changes)


def felt(
    force, tick, tip=(0.0, 0.0, 0.0), model=(0.0, 0.0, 0.0), off_plan=(0.0, 0.0, 0.0), down=True
):
    three = lambda values: (Vec(jnp.float64(v) for v in values),)  # noqa: E731
    force = (jnp.float64(force),)
    return reaction.OperatorSenses(
        force, three(tip), three(model), three(off_plan), jnp.bool_(down), jnp.int32(tick)
    )


def after_pull(action, **changes):
    """State at tick 400, packet 390, of an operator who felt a pull in tick 100."""
    asked = params(action, **changes)
    state, _ = reaction.feel_cue(asked, reaction.init(), felt(0.01, 100))
    return asked, reaction.react_to_cue(SETUP, asked, state, jnp.int32(400), jnp.int32(390))


def deviation(asked, state, row):
    return reaction.packet_deviation(SETUP, asked, state, jnp.int32(row), jnp.int32(row - 1))


def test_the_action_begins_after_the_reaction_time():
    asked = params("release", delay_ms=250.0)
    state, _ = reaction.feel_cue(asked, reaction.init(), felt(0.01, 100))
    state, _ = reaction.feel_cue(asked, state, felt(0.02, 101))
    assert int(state.felt) == 100
    early = reaction.react_to_cue(SETUP, asked, state, jnp.int32(349), jnp.int32(349))
    assert int(early.acted) == -1
    due = reaction.react_to_cue(SETUP, asked, early, jnp.int32(350), jnp.int32(350))
    assert int(due.acted) == 350
    later = reaction.react_to_cue(SETUP, asked, due, jnp.int32(351), jnp.int32(351))
    assert int(later.acted) == 350 and int(later.acted_packet) == 350


@pytest.mark.parametrize("force, down", [(0.0, True), (0.005, True), (0.02, False)])
def test_what_is_too_weak_or_comes_with_the_pedal_up_is_not_felt(force, down):
    asked = params("release", felt_force=0.005)
    state, _ = reaction.feel_cue(asked, reaction.init(), felt(force, 100, down=down))
    assert int(state.felt) == -1


def test_release_holds_from_its_packet_on_and_not_in_older_ones():
    asked, state = after_pull("release")
    lifted = [bool(deviation(asked, state, row).lifted) for row in (389, 390, 1000)]
    assert lifted == [False, True, True]


@pytest.mark.parametrize("slow_to", [0.0, 0.25, 1.0])
def test_slowed_hands_fall_behind_in_proportion(slow_to):
    asked, state = after_pull("slow", slow_to=slow_to)
    lags = [int(deviation(asked, state, row).lag) for row in (100, 390, 394, 790)]
    assert lags == [0, 0, int(4 * (1 - slow_to)), int(400 * (1 - slow_to))]
    assert not bool(deviation(asked, state, 790).lifted)


@pytest.mark.slow
def test_correction_goes_to_where_the_instrument_was_meant_to_be():
    """A robot 4 mm off that follows its hands: the remaining distance shrinks by exp(-t/0.2 s),
    at most 50 mm/s.
    """
    asked, state = after_pull("correct")
    offset, moved = np.array([0.004, 0.0, 0.0]), np.zeros(3)
    distances = []
    for tick in range(400, 1400):
        distances.append(np.linalg.norm(offset + moved))
        shown = felt(0.05, tick, tip=offset + moved, model=moved, off_plan=moved)
        state, (more,) = reaction.feel_cue(asked, state, shown)
        moved = moved + np.array([float(x) for x in more])
    speed = -np.diff(distances) / 1e-3
    assert speed.max() <= 0.05 + 1e-9
    np.testing.assert_allclose(distances[200] / distances[0], np.exp(-1.0), rtol=0.01)
    assert distances[-1] < 0.01 * distances[0]


@pytest.mark.parametrize("action, down", [("release", True), ("slow", True), ("correct", False)])
def test_nobody_else_corrects(action, down):
    asked, state = after_pull(action)
    _, (more,) = reaction.feel_cue(asked, state, felt(0.05, 400, tip=(0.004, 0, 0), down=down))
    assert [float(x) for x in more] == [0.0, 0.0, 0.0]
