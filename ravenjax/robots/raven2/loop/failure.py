"""Which numbers of a Raven's tick fail a run where one is not finite, beside those that the
monitor watches.
"""

from __future__ import annotations

from ravenjax.numbers import finite
from ravenjax.numbers.vec import Scalar, replace
from ravenjax.robots.raven2.loop.records import TickState
from ravenjax.robots.raven2.plant import robot as plant
from ravenjax.stages import monitor


def watched(
    state: TickState, robots: tuple[plant.PlantOutput, ...], now: Scalar
) -> monitor.MonitorState:
    """The monitor after this tick. state: all of it after the tick; robots: the virtual robot in
    it.

    Velocities are not looked at: they are in the next tick's positions.
    """
    numbers = {"joint": [x for out in robots for x in (*out.jpos, *out.mpos)]}
    if state.overload is not None:
        numbers["cable"] = [state.overload.peak]
    if state.touch is not None:
        numbers["contact"] = [state.touch.impulse]
    if state.hands is not None:
        numbers["hand"] = [x for offset in state.hands.offset for x in offset]
    if state.own_operator is not None and state.own_operator.grasp is not None:
        numbers["hand"] = [*numbers.get("hand", ()), *state.own_operator.grasp.offset]
    return replace(state.monitor, finite=finite.step(state.monitor.finite, numbers, now))
