"""Finds settings of a campaign that have no effect, are never reached, or are always active.

Such settings are valid, so they are not errors. The terminal, `ravenjax check`, manifest.json and
the report show them as notices. `of_config` examines the sections of the file. `of_plan` also
examines the parameters and faults of each run.
"""

import operator
from collections.abc import Iterator

import numpy as np
import pandas as pd

from ravenjax import resources
from ravenjax.campaign.faults import design, span, table
from ravenjax.campaign.file import bounds, location, semantics
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import SAMPLED, Group
from ravenjax.campaign.plan import Plan
from ravenjax.errors import suggest_unit
from ravenjax.numbers import paths
from ravenjax.store.motion.summary import list_names
from ravenjax.vocabulary.effects import EFFECT_CODES, RANDOM, TRIGGER_CODES
from ravenjax.vocabulary.sites import PARAMETER, Channel

MOST_COMPARED = 2**20
"""Largest number of runs among which equal runs are searched. For more runs it takes seconds."""
PLAUSIBLE = resources.read_tables(__file__, "notices.toml")["plausible"]
"""Ranges of some keys. A value outside has probably another unit."""
PEDAL_TICKS = 16
"""Ticks before and after a change of the run level in which the pedal's signals may differ."""
NAMED = 4
"""Number of groups that a notice names."""


def of_plan(plan: Plan) -> tuple[str, ...]:
    """Return all notices of a campaign as sentences, in the order of the file."""
    notices = list(of_config(plan.config))
    if plan.operator is not None:
        notices += [f"operator.file: {notice}" for notice in plan.operator.notices]
    notices += _of_parameters(plan)
    # runs: bool [runs], the runs that a notice is about.
    of_runs = *plan.config.notices_of_runs(plan), *_of_pedal(plan), *_of_faults(plan)
    notices += [
        f"{key}: {words}: {_count_runs(plan, runs)}" for key, runs, words in of_runs if runs.any()
    ]
    if plan.runs <= MOST_COMPARED and (count := int(find_copies(plan).sum())):
        notices.append(
            f"group: {count} of {plan.runs} runs have the same inputs as an earlier run, so they"
            " have the same outcome; equal runs count once"
        )
    return tuple(notices)


def of_config(config: CampaignConfig) -> Iterator[str]:
    """Yield "key: message" for each setting in the sections of a file that has no effect."""
    for key, message in config.notices():
        yield f"{location.format_key(key)}: {message}"
    least, largest = config.distances_mm
    of_tip = [(n, d.threshold) for n, d in enumerate(config.detector) if d.kind == "tip_error"]
    for key, values, lowest in (
        ("haptics.threshold_mm", config.haptics.threshold_mm, least),
        ("outcomes.limit_mm", config.outcomes.limit_mm, least),
        ("outcomes.jump_step_mm", config.outcomes.jump_step_mm, 0.0),
        ("outcomes.large_jump_mm", config.outcomes.large_jump_mm, 0.0),
        *((f"detector[{number}].threshold", values, least) for number, values in of_tip),
    ):
        for value in np.ravel(values).tolist():
            unit = suggest_unit("_mm", value, least, largest)
            if value >= largest:
                yield (
                    f"{key}: {value:g} mm is never reached: two positions of the tip are at most"
                    f" {largest:g} mm apart"
                )
            elif value <= lowest:
                yield (
                    f"{key}: {value:g} mm is always exceeded: without a fault the moving tip is"
                    f" already {lowest:g} mm away from the nominal model{unit}"
                )
    for key, (low, high) in PLAUSIBLE.items():
        value = operator.attrgetter(key)(config) or low
        if not low <= value <= high and (unit := suggest_unit(key, value, low, high)):
            yield f"{key}: got {value:g}{unit}"
    for kind, parts in (("detector", config.detector), ("check", config.check)):
        for number, part in enumerate(parts):
            key = f"{kind}[{number}]"
            thresholds = np.ravel(part.threshold)
            if 0.0 in thresholds:
                yield f"{key}.threshold: any score exceeds 0, so the alarm is always on"
            if len(np.unique(thresholds)) < len(thresholds):
                yield f"{key}.threshold: contains a number twice; the second one has no effect"
            alike = [part.model_copy(update={"name": other.name}) == other for other in parts]
            if (first := alike.index(True)) < number:
                yield f"{key}: differs from {kind}[{first}] only in its name"
    for number, one in enumerate(config.harm):
        if one.counts != "watch":
            verb = "counts beside" if config.limit_counts else "counts instead of"
            limit = f"a motion of more than {config.outcomes.limit_mm:g} mm"
            yield f"harm[{number}]: {one.name} {verb} {limit}: {one.when}"
    cues = config.haptics.cues()
    for number, cue in enumerate(cues):
        if (first := cues.index(cue)) < number:
            yield f"haptics: set {number} is the same as set {first}"
        if not cue.cap or not (cue.kp or cue.kd):
            yield f"haptics: set {number} has cap 0, or no spring and damper, so its force is 0"
    if (limit := config.campaign.limit) is not None and limit >= design.count_rows(config):
        yield f"campaign.limit: {limit} limits nothing, because the campaign has no more runs"
    if config.stop is not None:
        if config.stop.looks == (1.0,):
            yield "stop.looks: the only look is at the end, so the campaign cannot stop early"
        if config.stop.allocation == "neyman" and sum(bool(g.fault) for g in config.group) == 1:
            yield "stop.allocation: has no effect, because only one group has faults"
    if config.campaign.seed and not any(_draws(config, group) for group in config.group):
        yield "campaign.seed: has no effect, because nothing in the campaign is random"
    for path in config.parameters:
        if all(
            path in group.parameters
            or (group.run and all(path in run.parameters for run in group.run))
            for group in config.group
        ):
            yield f"parameters.{path}: no run has this value, because every group has another value"
    robot = config.robot
    for g, group in enumerate(config.group):
        for f, fault in enumerate(() if group.run else group.fault):
            if fault.wraps and not any(semantics.find_unfit_values(config, group, fault, False)):
                yield f"group[{g}].fault[{f}].wraps: has no effect, as all values fit into 16 bits"
        if config.campaign.noise and semantics.is_silent(config, group):
            yield f"campaign.noise: has no effect in group {group.name!r}, because all noise is 0"
    for key, axes in config.parameter_tables():
        for path, axis in axes.items() if not config.campaign.noise else ():
            if bounds.shorten_path(robot, path) in robot.noise and axis.values != (0,):
                name = location.format_key((*key, path))
                yield f"{name}: has no effect without campaign.noise = true"


def _draws(config: CampaignConfig, group: Group) -> bool:
    """Return whether the runs of a group depend on the campaign's seed."""
    tables = [dict(fault.axes()) for fault in group.fault] + [config.parameters, group.parameters]
    return (
        config.stop is not None
        or group.design in SAMPLED
        or semantics.random_in_itself(config, group)
        or any(axis.drawn for axes in tables for axis in axes.values())
    )


def _of_parameters(plan: Plan) -> Iterator[str]:
    # Yields notices of varied parameters that have no effect, or whose effect no outcome shows.
    program = plan.program
    fault_free = ~(plan.faults["code"] > 0).any(axis=1)
    useless, hidden = [], []
    for path, values in table.varied_parameters(plan.rows).items():
        # One path may name several numbers of the robot. NaN: the run does not set the parameter.
        usual = list(paths.named_numbers(program.params, program.setup, path).values())
        same = [np.float32(values) == np.float32(number) for number in usual]
        unchanged = np.isnan(values) | np.all(same, axis=0)
        if unchanged.all():
            useless.append(f"{path} = {float(usual[0]):g}")
        elif (fault_free & ~unchanged).any():
            hidden.append(f"{path} (the robot's value: {float(usual[0]):g})")
    if useless:
        yield (
            f"parameters.{list_names(useless, NAMED)}: this is already the robot's value, so the"
            " setting has no effect"
        )
    if hidden:
        yield (
            f"parameters.{list_names(hidden, NAMED)}: runs without a fault have another value than"
            " the robot's. Their golden runs also have this value, so no outcome shows its effect."
            " A fault at site parameter shows the effect of a parameter that the robot reads in"
            " every tick"
        )
    if program.ends and bool((plan.ends == program.ticks).all()):
        yield "campaign.observe_ms: has no effect, because all runs last for campaign.duration_s"


OfRuns = Iterator[tuple[str, np.ndarray, str]]
"""(key, bool [runs], notice); of faults bool [runs, slots]."""


def _of_pedal(plan: Plan) -> OfRuns:
    # Yields a notice if runs end before the pedal is down, unless faults may move the pedal.
    clocks = plan.any_clocks
    if clocks is not None and not clocks.moved.any():
        late = clocks.first_down(plan.program.ticks) >= plan.program.ticks
        words = "the run ends before the robot is in pedal-down, so no instrument moves"
        yield "campaign.duration_s", late, words


def _of_faults(plan: Plan) -> OfRuns:
    if not plan.faults["code"].any():
        return
    faults, ticks, unit = plan.faults, plan.program.ticks, plan.tick_ms
    start, length, every = (faults[key].astype(np.int64) for key in ("start", "duration", "every"))
    clocks, there = plan.any_clocks, faults["code"] > 0
    closes = span.last_window_ends(faults, ticks, clocks)
    opens = there & (closes > 0)
    lasts = opens & (every == 0) & (length < table.FOREVER_TICKS)
    beyond = np.where(lasts, np.clip(start + length - _clock_ends(plan), 0, length), 0)
    worst = np.unravel_index(np.argmax(beyond / np.maximum(length, 1)), beyond.shape)
    unread = [plan.config.robot.sites[site].unread for site, _ in _channels(plan)]
    unread = np.array([False, *unread])
    columns = [values for name, values in faults.items() if name != "key"]
    twice, hidden = np.zeros_like(there), np.zeros_like(there)
    drawn = [EFFECT_CODES[name] for name in RANDOM]
    timed = there & (faults["trigger"] == TRIGGER_CODES["time"])
    overwrites = timed & (every == 0) & (faults["effect"] == EFFECT_CODES["overwrite"])
    for slot in range(1, there.shape[1]):
        same = [values[:, :slot] == values[:, slot : slot + 1] for values in columns]
        fixed = there[:, slot] & ~np.isin(faults["effect"][:, slot], drawn)
        equal = np.logical_and.reduce(same)
        twice[:, slot] = fixed & equal.any(axis=1)
        # Of two faults on one channel, the one in the later slot acts last.
        channel = faults["code"][:, :slot] == faults["code"][:, slot : slot + 1]
        within = (start[:, :slot] >= start[:, slot : slot + 1]) & (
            closes[:, :slot] <= closes[:, slot : slot + 1]
        )
        hides = overwrites[:, slot : slot + 1] & timed[:, :slot] & channel & within
        hidden[:, :slot] |= hides & ~equal
    early, down = np.zeros_like(there), ticks
    if clocks is not None:
        first = clocks.first_down(ticks)
        moved = clocks.moved[faults["code"]].any(axis=1, keepdims=True)
        ahead = (closes <= first[:, None]) & (first < ticks)[:, None]
        early, down = opens & ahead & ~moved, first.min()
    single = opens & (every > 0) & (start + every >= ticks)
    cut = f"up to {beyond[worst] * unit} of {length[worst] * unit} ms"
    for key, which, words in (
        *_beyond_range(plan),
        ("start_ms", there & ~opens, "the fault does not begin before the end of the run"),
        ("start_ms", early, f"the fault ends before the robot is in pedal-down, at {down} ms"),
        (
            "duration_ms",
            beyond > 0,
            f"{cut} are after the end of the run, which cuts the fault short",
        ),
        ("every_ms", single, "the fault is not repeated before the end of the run"),
        ("value", there & _idle(plan), "changes the signal by at most one count, or not at all"),
        ("site", unread[faults["code"]], "nothing in the robot reads this signal"),
        ("site", twice, "the run has the same fault twice"),
        ("site", hidden, "has no effect: a later fault overwrites the signal during all of it"),
    ):
        yield from ((f"fault[{slot}].{key}", marks, words) for slot, marks in enumerate(which.T))


def _beyond_range(plan: Plan) -> OfRuns:
    """Yield (key, faults, notice) about faults that move a parameter out of its range."""
    value, length, usual = _numbers(plan)
    for code, (site, channel) in enumerate(_channels(plan), start=1):
        if site != PARAMETER or (limits := channel.field) is None:
            continue
        is_nearer_low = usual - limits.low < limits.high - usual
        # The number farthest out of range, by effect. The values of "overwrite" and "toggle" were
        # checked before, but "toggle" also gives 0.
        reached = {
            **dict.fromkeys(("offset", "latch_offset"), usual + value),
            "scale": usual * value,
            "drift": usual + value * length,
            "periodic": np.where(is_nearer_low, usual - abs(value), usual + abs(value)),
            "random": np.where(-abs(value) < limits.low, -abs(value), abs(value)),
            "toggle": 0.0 * value,
        }
        # Faults at other channels get a number inside the range, so they have no notice.
        number = _by_effect(plan, reached, default=usual)
        number = np.where(plan.faults["code"] == code, number, limits.low)
        outside = np.maximum(limits.low - number, number - limits.high)
        worst = number.flat[outside.argmax()]
        words = f"{channel.name} becomes {worst:.6g}, expected {limits.low:g}..{limits.high:g}"
        yield "value", outside > 0, words


# A value beyond single precision becomes infinite, which is never a usual value.
@np.errstate(over="ignore")
def _idle(plan: Plan) -> np.ndarray:
    # Returns bool [runs, slots]: faults that do not change their signal. usual: the value that a
    # constant signal has without a fault; NaN for other signals.
    value, length, usual = _numbers(plan)
    is_constant = ~np.isnan(usual)
    # A change of an integer by less than 1 has no effect. Code 0 means that there is no fault.
    least = [float(channel.kind not in ("float", "bool")) for _, channel in _channels(plan)]
    least_change = np.array([0.0, *least])[plan.faults["code"]]

    def is_small(change: np.ndarray) -> np.ndarray:
        # A parameter is stored in single precision.
        same = np.float32(usual + change) == np.float32(usual)
        return (abs(change) < least_change) | (change == 0) | same

    idle = {
        "overwrite": np.float32(value) == np.float32(usual),
        "offset": is_small(value),
        # "latch_offset" and "stuck" hold a value, which changes any signal that is not constant.
        "latch_offset": is_small(value) & is_constant,
        "scale": (value == 1) | (np.float32(usual * value) == np.float32(usual)),
        "drift": is_small(value * length),
        "stuck": is_constant,
        # At whole ticks, sin(2 pi n / period) is 0 for periods of 1 and 2 ticks.
        "periodic": is_small(value) | (plan.faults["period"] <= 2),
        **dict.fromkeys(("random", "toggle"), (value == 0) & (usual == 0)),
        "lose": value == 0,
    }
    return _by_effect(plan, idle, default=False)


def _channels(plan: Plan) -> list[tuple[str, Channel]]:
    """Return (site, channel) of all faults. The code of a fault is its position here, from 1."""
    targets = plan.program.setup.injection.channels
    return [(site, plan.config.robot.sites[site].channel(name)) for site, _, name in targets]


def _numbers(plan: Plan) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return value, active ticks and the signal's constant (or NaN) of faults, [runs, slots]."""
    usual = np.full(plan.faults["code"].shape, np.nan)
    for code, (site, channel) in enumerate(_channels(plan), start=1):
        constant = channel.name if site == PARAMETER else channel.usual
        # A text is the path of a parameter with this value. A signal of the pedal has one constant
        # value while the pedal is up, and another while it is down.
        if isinstance(constant, str):
            constant = plan.numbers(constant)[:, None]
        elif channel.pedal:
            constant = _pedal_values(plan, *channel.pedal)
        if constant is not None:
            usual = np.where(plan.faults["code"] == code, constant, usual)
    ticks = np.minimum(plan.faults["duration"], plan.program.ticks - plan.faults["start"])
    return plan.faults["value"].astype(np.float64), ticks, usual


def _pedal_values(plan: Plan, up: float, down: float) -> np.ndarray:
    """Return the value that a signal has during each fault without the fault, [runs, slots]. up,
    down: its values while the pedal is up and down. The result is NaN if the pedal may move during
    the fault, or if the times of the pedal are unknown.
    """
    faults, clocks, ticks = plan.faults, plan.any_clocks, plan.program.ticks
    setup = plan.program.setup
    numbers = np.full(faults["code"].shape, np.nan)
    # An operator who reacts may lift the pedal at any time. In the software of 2015, the run level
    # is pedal-down before the foot presses the pedal.
    if clocks is None or "reaction" in setup.stages or setup.software != "raven2":
        return numbers
    starts, closes = faults["start"], span.last_window_ends(faults, ticks, clocks)
    by_time = (faults["trigger"] == TRIGGER_CODES["time"]) & (closes > 0)
    # Another fault of the run could stop the robot, which changes these signals.
    alone = by_time & (np.count_nonzero(faults["code"], axis=1, keepdims=True) == 1)
    # Each kind of run has its own phases in which the pedal is down. They begin and end up to
    # `later` ticks after `begins` and `ends`. If `later` is None, the times are unknown.
    for kind, (begins, ends, later) in enumerate(clocks.phases):
        of_kind = alone & (clocks.kind == kind)[:, None]
        if later is None or not len(begins):
            continue
        # The signals may change up to PEDAL_TICKS before a phase begins or ends.
        numbers[of_kind & (closes < begins[0] - PEDAL_TICKS)] = up
        for latest_begin, end in zip(begins + later, ends, strict=True):
            last = end - PEDAL_TICKS if end < ticks else ticks
            numbers[of_kind & (starts >= latest_begin) & (closes <= last)] = down
    return numbers


def _by_effect(plan: Plan, results: dict[str, np.ndarray], default) -> np.ndarray:
    """Return for each fault the entry of `results` for its effect, [runs, slots]."""
    effects = [plan.faults["effect"] == EFFECT_CODES[effect] for effect in results]
    return np.select(effects, list(results.values()), default)


def _count_runs(plan: Plan, runs: np.ndarray) -> str:
    """Return as text how many runs of each group `runs` (bool [runs]) marks."""
    groups = plan.rows["group"].cat
    sizes, counts = np.bincount(groups.codes), np.bincount(groups.codes[runs])
    names = groups.categories
    named = (f"{counts[g]} of {sizes[g]} runs of group {names[g]}" for g in np.flatnonzero(counts))
    return list_names(named, NAMED)


def _clock_ends(plan: Plan) -> np.ndarray:
    """Return the first reading of each fault's clock after the end of a run, int [runs, slots]."""
    trigger, ticks, clocks = plan.faults["trigger"], plan.program.ticks, plan.any_clocks
    # Clocks count ticks, packets (from 1), or ticks since the pedal went down. If faults may move
    # the pedal, the time of its first press is unknown, and 0 gives the latest possible reading.
    down = 0 if clocks is None or clocks.moved.any() else clocks.first_down(ticks)[:, None]
    pedal = np.where(trigger == TRIGGER_CODES["pedal"], down, 0)
    return ticks + (trigger == TRIGGER_CODES["packet"]) - pedal


def find_copies(plan: Plan) -> np.ndarray:
    """Return which runs must have the outcome of an earlier run, bool [runs]. Their inputs are
    equal, and nothing in them is random. A fault that would last beyond the end of the run equals a
    fault that ends with the run.
    """
    is_random = {g.name: semantics.random_in_itself(plan.config, g) for g in plan.config.group}
    fixed = ~plan.rows["group"].map(is_random.__getitem__).to_numpy(bool)
    # The keys of random numbers do not matter in these runs.
    ticks, faults = plan.program.ticks, {k: v for k, v in plan.faults.items() if k != "key"}
    # A repetition after the end of the run becomes 0, and a duration ends with the run.
    every = np.where(faults["start"] + faults["every"] < ticks, faults["every"], 0)
    longest = np.where(every == 0, _clock_ends(plan) - faults["start"], ticks)
    faults |= {"every": every, "duration": np.minimum(faults["duration"], longest)}
    # Faults act in the order of their slots, which matters only on the same channel.
    order = np.argsort(faults["code"], axis=1, kind="stable")
    faults = {name: np.take_along_axis(values, order, axis=1) for name, values in faults.items()}
    inputs = {
        f"{name}{slot}": values[:, slot]
        for name, values in faults.items()
        for slot in range(values.shape[1])
    }
    inputs |= {path: values for path, values in plan.varied.items() if path not in plan.keys}
    frame = pd.DataFrame(inputs, index=range(plan.runs), copy=False)
    # Without any input all runs are equal.
    if frame.empty:
        return fixed & (np.arange(plan.runs) > 0)
    return fixed & frame.duplicated().to_numpy()
