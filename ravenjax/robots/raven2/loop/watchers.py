"""Optional stages that look at a tick when it is over, and change nothing in it.

Another one is a value in WATCHERS: its state is in the tick's, its outcomes are in the result
table, and a run fails where one of its `numbers` is not finite.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from ravenjax.numbers.vec import Scalar
from ravenjax.robots.raven2.loop.records import TickParams, TickSignals
from ravenjax.robots.raven2.loop.user_files import UserFiles
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import detectors, overload, touch


class Sight(NamedTuple):
    """What a watcher may look at."""

    tick: Scalar  # int32
    live: Scalar  # bool, pedal-down without software E-stop
    signals: TickSignals
    files: UserFiles


class Watcher(NamedTuple):
    """One of them."""

    present: Callable[[RavenSetup], bool]
    init: Callable[[RavenSetup, TickParams], Any]
    step: Callable[[RavenSetup, TickParams, Any, Sight], Any]
    outcomes: Callable[[RavenSetup, Any], dict[str, Scalar]]
    numbers: Callable[[Any], dict[str, list[Scalar]]] = lambda state: {}
    # before the monitor: a CPU has its many operations to do while those of a long chain wait
    early: bool = False


def find_watchers(setup: RavenSetup) -> dict[str, Watcher]:
    """Those that are in the tick, by name."""
    return {name: watcher for name, watcher in WATCHERS.items() if watcher.present(setup)}


def _detect(setup: RavenSetup, params: TickParams, state: Any, sight: Sight) -> Any:
    assert params.detectors is not None
    signals, robots = sight.signals, sight.signals.plant
    models, cues = signals.nominal, signals.haptics
    sight.files.note(
        brakes=signals.plc.brakes,
        model_jpos=tuple(model.jpos for model in models),
        model_tip=tuple(model.tip_position for model in models),
        tip_error=tuple(cue.distance for cue in cues),
    )
    views: tuple[Any, ...] = ()
    if detectors.sources(setup):
        tips = zip(models, cues, strict=True)
        sight.files.note(tip=tuple(model.tip_position - cue.error for model, cue in tips))
        views = sight.files.views("the end", setup.precision.real)
    seen = detectors.DetectorSignal(
        mpos=tuple(out.mpos for out in robots),
        mvel=tuple(out.mvel for out in robots),
        jpos=tuple(out.jpos for out in robots),
        jvel=tuple(out.jvel for out in robots),
        tip_error=tuple(cue.distance for cue in cues),
        command=tuple(arm.current_cmd for arm in signals.control.arms),
        command_limit=params.control.overdrive.dac_max,
        armed=sight.live,
        tick=sight.tick,
        views=views,
    )
    return detectors.step(setup, params.detectors, state, seen)


def _add_loads(setup: RavenSetup, params: TickParams, state: Any, sight: Sight) -> Any:
    loads = tuple(
        out.carried * arm.cable_strength.map(lambda strength: 1.0 / strength)
        for out, arm in zip(sight.signals.plant, params.plant, strict=True)
    )
    return overload.step(state, loads, sight.tick)


def _add_touches(setup: RavenSetup, params: TickParams, state: Any, sight: Sight) -> Any:
    touches = (out.touch for out in sight.signals.plant)
    return touch.step(state, tuple(one for one in touches if one is not None))


WATCHERS: dict[str, Watcher] = {
    "detectors": Watcher(
        lambda setup: bool(setup.detectors),
        lambda setup, params: detectors.init(setup, params.detectors),  # type: ignore[arg-type]
        _detect,
        detectors.outcomes,
        early=True,
    ),
    "overload": Watcher(
        lambda setup: setup.cables != "unwatched",
        lambda setup, params: overload.init(setup),
        _add_loads,
        lambda setup, state: overload.outcomes(state),
        lambda state: {"cable": [state.peak]},
    ),
    "touch": Watcher(
        lambda setup: setup.contact,
        lambda setup, params: touch.init(setup),
        _add_touches,
        touch.outcomes,
        lambda state: {"contact": [state.impulse]},
    ),
}
