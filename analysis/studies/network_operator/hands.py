"""An operator who closes the loop: corrects by sight, slows down and waits if the tip does not
follow, and clutches again.

The hands carry out the plan of the gold arm. The operator sees where the tip is and knows where it
should be. The distance between both is felt after a first-order lag, which stands for the reaction
time. The hands remove a share of it each second and slow down in proportion to it; at `wait_mm`
they rest. If they have rested for long, or moved far since the last clutch, the foot lifts the
pedal and presses it again. The share that is removed per second falls with the delay of the
network, so that its product with the whole lag stays the same: people adapt in this way (McRuer and
Jex, A review of quasi-linear pilot models, IEEE Trans. HFE-8, 1967).
"""

from ravenjax.parts import Annotated, Quantity, Scalar, Vec, jnp, record, where

SAMPLE_MS, SAMPLES = 20, 28
"""What is seen late is remembered every 20 ms, for 560 ms."""
FASTEST = 0.05
"""m/s of the tip: fastest correction, as the built-in operator's."""


@record
class Operator:
    pace: Annotated[Scalar, Quantity("", 0, 1, "speed of the hands as a share of the plan's")]
    wait_mm: Annotated[
        Scalar, Quantity("mm", 0.1, 1000, "distance from tip to plan at which the hands rest")
    ]
    correct_per_s: Annotated[
        Scalar, Quantity("1/s", 0, 20, "share of that distance that the hands remove per second")
    ]
    patience_ms: Annotated[
        Scalar, Quantity("ms", 0, 1e6, "rest after which the operator clutches again")
    ]
    reach_mm: Annotated[
        Scalar, Quantity("mm", 1, 1e6, "motion of the hand, times the scale, from clutch to clutch")
    ]
    clutch_ms: Annotated[Scalar, Quantity("ms", 1, 1e5, "time for which a clutch lifts the pedal")]
    reaction_ms: Annotated[Scalar, Quantity("ms", 1, 1e4, "time constant of the reaction to sight")]
    delay_ms: Annotated[
        Scalar, Quantity("ms", 0, SAMPLE_MS * SAMPLES, "delay of the network, as seen")
    ]
    feels: Annotated[
        Scalar, Quantity("", 0, 1, "1: the operator lifts the pedal for good at a cue", whole=True)
    ]
    feels_after_ms: Annotated[Scalar, Quantity("ms", 0, 1e5, "time from the cue to that action")]


@record
class Memory:
    wanted: Vec  # m, where the tip should be, console's axes
    seen: Vec  # m, earlier tips, the newest first
    felt: Vec  # m, from tip to plan, as perceived
    rested_ms: Scalar  # time for which the tip has been too far away
    lifted_ms: Scalar  # time for which the pedal stays lifted; 0: it is down
    since_mm: Scalar  # motion of the hand since the last clutch
    cue_ms: Scalar  # time since the first cue; 0: none yet
    done_ms: Scalar  # progress in the plan
    path_mm: Scalar  # motion of the hand, times the scale
    presses: Scalar  # times that the pedal was pressed again
    tests: Scalar  # of these: because the tip did not follow


def params():
    return Operator(
        # Fitted to people (study network_operator)
        pace=0.94,
        wait_mm=5.3,
        correct_per_s=2.0,
        patience_ms=3100.0,
        reach_mm=160.0,
        # Assumed
        clutch_ms=500.0,
        reaction_ms=250.0,
        delay_ms=0.0,
        feels=0,
        feels_after_ms=280.0,
    )


def init(params):
    still = Vec((0.0, 0.0, 0.0))
    return Memory(still, Vec.full(3 * SAMPLES, 0.0), still, *(0.0,) * 8)


def step(params, state, view):
    arm = view.arms[0]
    begins = view.tick == 0
    live = (view.runlevel == 3) & view.pedal
    down = state.lifted_ms <= 0.0
    moves = live & down

    earlier = where(begins, Vec(tuple(arm.tip) * SAMPLES), state.seen)
    kept = Vec((*arm.tip, *earlier[:-3]))
    earlier = where(view.tick % SAMPLE_MS == 0, kept, earlier)
    tip = arm.tip
    for place in range(SAMPLES):
        late = params.delay_ms > SAMPLE_MS * (place + 0.5)
        tip = where(late, Vec(earlier[3 * place : 3 * place + 3]), tip)

    wanted = where(begins, arm.tip, state.wanted) + arm.delta * (view.scale * 1e-6)
    felt = state.felt + (wanted - tip - state.felt) / params.reaction_ms
    distance = jnp.sqrt(felt[0] * felt[0] + felt[1] * felt[1] + felt[2] * felt[2])
    adapted = params.reaction_ms / (params.reaction_ms + params.delay_ms)
    speed = jnp.minimum(params.correct_per_s * adapted * distance, FASTEST)
    correction = felt * (speed / jnp.maximum(distance, 1e-9) * 1e3 / view.scale)
    motion = where(moves, arm.delta + correction, arm.delta)
    far = distance * 1e3 / params.wait_mm
    pace = jnp.where(moves, params.pace * jnp.maximum(1.0 - far, 0.0), 0.0)
    length = motion[0] * motion[0] + motion[1] * motion[1] + motion[2] * motion[2]
    moved = jnp.where(moves, jnp.sqrt(length) * (view.scale * 1e-3), 0.0)

    rested = jnp.where(moves & (far >= 1.0), state.rested_ms + 1.0, 0.0)
    since = state.since_mm + moved
    tests = rested > params.patience_ms
    lifts = tests | (since > params.reach_mm)
    lifted = jnp.where(lifts, params.clutch_ms, jnp.maximum(state.lifted_ms - 1.0, 0.0))

    feels = (state.cue_ms > 0.0) | (live & (arm.force > 0.0))
    cue = jnp.where(feels & (params.feels == 1), state.cue_ms + 1.0, 0.0)

    memory = Memory(
        wanted=wanted,
        seen=earlier,
        felt=felt,
        rested_ms=jnp.where(lifts, 0.0, rested),
        lifted_ms=lifted,
        since_mm=jnp.where(lifts, 0.0, since),
        cue_ms=cue,
        done_ms=state.done_ms + pace,
        path_mm=state.path_mm + moved,
        presses=state.presses + jnp.where(lifts, 1.0, 0.0),
        tests=state.tests + jnp.where(tests, 1.0, 0.0),
    )
    hands = {
        "delta": (motion, *(other.delta for other in view.arms[1:])),
        "pace": jnp.where(live, pace, 1.0),
        "pedal": (lifted <= 0.0) & (cue <= params.feels_after_ms),
    }
    return memory, hands
