"""Compiles a session: a campaign's tick that also fills a frame, and a fault table with rows to
arm.

Every hazard of a session is one row of a campaign's fault table. So it is checked, named and
replayed like any other row. The last row is the E-stop button's, and it has a fault slot of its
own, one more than the table needs.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.campaign import compile_cache, plan
from ravenjax.campaign.faults import table
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.plan import Plan
from ravenjax.engines import trace_key
from ravenjax.engines.cpu.stepper import StepCode
from ravenjax.errors import UserError
from ravenjax.faults.fault import Faults, FaultSlot
from ravenjax.numbers.algebra import minus, norm
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec, as_int, replace
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.robots.raven2.console.packet import empty_packet
from ravenjax.robots.raven2.loop import observers, run, tick
from ravenjax.robots.raven2.loop.records import Input
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import monitor
from ravenjax.train.protocol import FrameLayout

SPARE_MS = 60_000
"""Extra rows of the motion table, for ticks after the session's end and for packets sent again."""

OLDER_PACKETS: dict[str, Sequence[str]] = {"console": (), "hand": (), "network": ("lost",)}
"""Sites that change what the console sends, with the channels that need the newest packet only."""

SOURCE = Path(__file__).read_bytes()
"""Part of the key for compiled code in the cache, because `make` also affects what is compiled."""


@dataclasses.dataclass(frozen=True, eq=False)
class Blueprint:
    """A compiled session, from which robots are made."""

    plan: Plan
    layout: FrameLayout
    code: StepCode
    # Varied parameters and faults at the start: no fault.
    inputs: Any
    # Slots of a row; the button's slot follows them.
    fault_slots: int
    # Whether packets come from an outside console, not from the motion.
    packets: bool

    @property
    def setup(self) -> RavenSetup:
        """The settings that select code."""
        return self.plan.program.setup


def make_blueprint(
    config: CampaignConfig, packets: bool = False, limit_mm: float = LIMIT_MM
) -> Blueprint:
    """Compile the session that `config` describes; its duration is the session's.

    packets: packets come from outside, at most one a tick. Raises UserError if a hazard then needs
    older packets. limit_mm: the observer's limit. It is not the campaign's, on which run ids and
    the random numbers of faults depend.
    """
    ready = plan.make_plan(config)
    slots = ready.program.setup.injection.slots
    for use in ready.program.setup.injection.sites if packets else ():
        for _, channel in use.channels:
            if use.site in OLDER_PACKETS and channel not in OLDER_PACKETS[use.site]:
                raise UserError(
                    f"a hazard acts at site {use.site!r}, channel {channel!r}, on the console's"
                    " side of the network, which is another process here. Leave it out of the"
                    " robot's scenario, or train without --robot"
                )
    setup = replace(
        ready.program.setup, injection=replace(ready.program.setup.injection, slots=slots + 1)
    )
    params = ready.program.params
    params = replace(params, monitor=replace(params.monitor, limit=limit_mm / 1e3))
    program = dataclasses.replace(ready.program, setup=setup, params=params)
    ready = dataclasses.replace(ready, program=program)
    layout = FrameLayout.of(setup.arms)
    # Values of the last row, the button's: they belong to no hazard.
    values_of_button = [values[-1] for values in ready.varied.values()]
    zeros = {name: np.zeros((), dtype) for name, dtype in table.ARRAYS.items()}
    empty = FaultSlot(**(zeros | {"period": np.ones((), np.int32)}))
    inputs = values_of_button, Faults((empty,) * (slots + 1))
    entering = (
        [np.float32(0.0)] * run.series_length(setup),
        np.bool_(False),
        empty_packet(setup) if packets else None,
    )
    columns = len(ready.columns)
    length = 1 if packets else config.campaign.ticks + SPARE_MS

    def begin(inputs: Any) -> tick.TickState:
        return run.init(setup, program.params_of(inputs[0]))

    def step(
        inputs: Any, state: tick.TickState, now: Scalar, entering: Any, motion: Any
    ) -> tuple[tick.TickState, list[Scalar]]:
        series, apart, packet = entering
        signal = Input(now, motion, run.reference_from(setup, series), packet, apart)
        params = program.params_of(inputs[0])
        new, signals = tick.advance_tick(setup, params, inputs[1], state, signal)
        frame = _frame(setup, params, now, new, signals, signal)
        return new, [jnp.float32(x) for x in (*frame, *run.reference_series(setup, signals))]

    def finish(inputs: Any, state: tick.TickState) -> dict[str, Scalar]:
        return run.outcomes(setup, program.params_of(inputs[0]), state)

    compile_cache.enable_cache()
    tables = (length,) * columns
    key = trace_key.hash_values(
        "session", SOURCE, setup, params, program.module, program.varied, packets
    )
    code = StepCode(
        begin, step, finish, inputs, entering, tables, compile_cache.object_cache(), key
    )
    return Blueprint(ready, layout, code, inputs, slots, packets)


def _frame(
    setup: RavenSetup,
    params: tick.TickParams,
    now: Scalar,
    state: tick.TickState,
    out: tick.TickSignals,
    signal: tick.Input,
) -> list[Scalar]:
    """Return the numbers of [simulated] in `channels.toml`, then [simulated_arm] of each arm."""
    active_fault = jnp.bool_(False)
    for active in out.fault_active:
        active_fault = active_fault | active
    software, observer = out.control, state.monitor
    pulls = jnp.bool_(False)
    for cue in out.haptics:
        pulls = pulls | (cue.force[0] > 0.0)
    live = observers.is_live(software.runlevel, state.control.state_machine.soft_estopped)
    numbers = [now, software.runlevel, software.surgeon_mode, software.soft_estopped, as_int(live)]
    numbers += [out.plc.runlevel, out.plc.brakes]
    trips = jnp.int32(0)
    for history in run.check_histories(setup, state).values():
        trips = trips + history.count
    numbers += [software.last_seq, as_int(active_fault), trips, out.tip_distance * 1e3]
    # `simulation` overwrites the last two with those of the golden run.
    numbers += [observer.halted, observer.halted, as_int(pulls)]
    positions = run.measured_tips(setup, software)
    golden = observers.golden_reference(setup, signal, out.tip, positions)
    for i, measured in enumerate(software.arms):
        cue, position = out.haptics[i], positions[i]
        position_m = (jnp.float32(x) * 1e-6 for x in position)
        pull = (x * cue.force[0] for x in cue.direction)
        numbers += [*measured.jpos, *measured.jpos_d, *measured.mpos, *measured.mvel]
        numbers += [*out.plant[i].jpos, *out.nominal[i].jpos]
        numbers += [*out.tip[i], *out.nominal[i].tip_position, *position_m]
        numbers += [cue.distance * 1e3, *pull, *measured.current_cmd_written]
        off = monitor.arm_distances(
            params.monitor, observer.arms[i], out.nominal[i].tip_position, position, golden.pos[i]
        )
        numbers += [out.depth[i] * 1e3, *hazard_distances(live, off)]
        numbers += [norm(minus(Vec(jnp.float32(x) for x in position), golden.pos[i])) * 1e-3]
        touch = out.plant[i].touch
        numbers += [0.0] * 5 if touch is None else [*touch.force, touch.vessel, touch.instrument]
    return numbers


def hazard_distances(live: Scalar, off: monitor.Distances) -> list[Scalar]:
    """Return unintended_mm, unintended_off_mm, loss_mm and false_report_mm of a frame."""
    while_live = jnp.where(live, 1e3, 0.0)
    return [
        off.unintended * while_live,
        off.unintended_off * (1e3 - while_live),
        off.loss * while_live,
        off.false_report * while_live,
    ]
