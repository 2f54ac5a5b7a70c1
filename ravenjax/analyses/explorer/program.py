"""Compiles a campaign's tick to WebAssembly, and describes as JSON how a page runs it.

Numbers are float32 or int32. Binaries and motions are little-endian words in base64. The script
`static/engine.js` reads the object of `describe_program`, with these keys:

- arms, ticks, tick_ms: arms of the robot, ticks of a run, and milliseconds of a tick
- observe_ms: time from the end of the last fault to the end of the run; null: a run has all ticks
- parameters: list of the parameters that the page can change, in the order of a run's inputs
- channels: list of the channels where faults act; a fault has the index of its channel, from 1
- effects: code of each effect; for a network effect also its channel and the value that it writes
- triggers: code of each trigger; slots: number of faults in a run
- fields: type of each number of a fault; forever: ticks of a fault window without an end
- motions: float32 columns of each motion, one after the other
- motion: name of the campaign's motion, "" for a recording
- programs: `outcomes` computes outcomes, `replay` also time series, and `acted` outcomes of runs
  with an action, which has its own fault slot. A program's `binary` imports only its memory, and
  computes `width` robots together. In each tick a golden run stores `series` numbers, and `replay`
  also stores `outputs`. Other keys are positions in memory, in bytes.
- actions: number of each action of `acted`; empty for a robot without actions
- harm_limit_mm: a larger motion after a stop is harm; null if the campaign file defines harm
- verdict: names of outcomes, and the response of each check
- cue: index of the haptic set whose cue counts in the verdict
- examples: the first fault of each group
- worker: text of `static/worker.js`, which a page starts from a Blob
"""

import base64
import dataclasses
import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax import resources
from ravenjax.campaign import outcomes, plan
from ravenjax.campaign.faults import table
from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.plan import Plan
from ravenjax.engines import traced, wasm
from ravenjax.engines.cpu.kernel import FUNCTIONS, print_kernel
from ravenjax.engines.interface import Block
from ravenjax.engines.traced import TracedTick
from ravenjax.errors import UserError
from ravenjax.faults.fault import FaultSlot
from ravenjax.ir.time_loop import TimeLoop, split_lanes
from ravenjax.numbers import paths, tree
from ravenjax.outcomes import verdict
from ravenjax.stages.recorded import read_series
from ravenjax.store import schema
from ravenjax.vocabulary import checks, failures
from ravenjax.vocabulary.effects import EFFECT_CODES, EFFECTS, NETWORK_EFFECTS, TRIGGER_CODES

WORDS = resources.read_tables(__file__, "words.toml")
"""Lists of parameters and series, and words for readers who do not know the manual."""

MOTION_BYTES = 3_000_000
"""Largest size of all motions of a page. If they are larger, the page has only the campaign's."""


def question_plan(config: CampaignConfig) -> Plan:
    """Return the campaign's plan, with parameters that a page can change as inputs of the program.

    These are parameters that the campaign varies, and parameters of `words.toml`. Raise UserError
    for a campaign with noise or without a fault.
    """
    planned = plan.make_plan(config)
    if config.campaign.noise:
        raise UserError("this web page cannot simulate noise: set campaign.noise to false")
    program = planned.program
    if not program.setup.injection.sites:
        raise UserError(
            f"campaign {config.campaign.name!r} has no fault, so a page has nothing to vary: add a"
            " [[group.fault]] to one of its groups; a page offers its site and effects"
        )
    # `keys`: inputs that are random keys. A page draws packets once, so all runs have key 0.
    varied = planned.varied | {key: np.zeros_like(planned.varied[key]) for key in planned.keys}
    # Full paths of the numbers that are inputs already.
    input_paths = set()
    for path in varied:
        input_paths.update(paths.named_numbers(program.params, program.setup, path))
    # Parameters of words.toml become inputs, too, unless a varied path already contains them.
    for full_path, value in paths.path_leaves(program.params, program.setup):
        # A page changes a parameter of all arms together. The dots end whole words of the path.
        path = paths.without_arm(full_path, program.setup.arms)
        is_offered = any(f"{path}.".startswith(f"{start}.") for start in WORDS["parameters"])
        if not is_offered or full_path in input_paths:
            continue
        input_paths.update(paths.named_numbers(program.params, program.setup, path))
        dtype = program.setup.precision.real if np.asarray(value).dtype.kind == "f" else np.int32
        varied[path] = np.full(planned.runs, value, dtype)
    # The page ends runs by itself, so the program needs only the triggers that a page offers.
    injection = program.setup.injection
    triggers = tuple(name for name in TRIGGER_CODES if name == "time" or name in injection.triggers)
    setup = dataclasses.replace(
        program.setup, injection=dataclasses.replace(injection, triggers=triggers)
    )
    program = dataclasses.replace(program, setup=setup, varied=tuple(varied))
    golden = plan.number_golden_runs(varied, planned.runs)
    return dataclasses.replace(planned, program=program, varied=varied, golden=golden)


def describe_program(config: CampaignConfig) -> dict[str, Any]:
    """Return what a page needs to repeat a campaign's runs, as a JSON object: programs and tables.

    The module's docstring explains the keys.

    Raise UserError for a campaign with noise or without a fault.
    """
    planned = question_plan(config)
    program = planned.program
    printable = traced.printable_program(program)
    # One lane is enough to trace the tick.
    tick = traced.trace_tick(printable, Block(*planned.lanes([0], 1), None), planned.columns)
    actions, action_programs = _action_programs(planned)
    return {
        "actions": actions,
        "harm_limit_mm": config.outcomes.limit_mm if config.limit_counts else None,
        "arms": program.setup.arms,
        "ticks": program.ticks,
        "tick_ms": program.setup.period_ms,
        "cue": config.outcomes.cue,
        "parameters": [_parameter(planned, path) for path in program.varied],
        "observe_ms": config.campaign.observe_ms,
        "slots": program.setup.injection.slots,
        "channels": _channels(planned),
        "effects": {name: _effect(name) for name in EFFECTS},
        "triggers": {name: TRIGGER_CODES[name] for name in program.setup.injection.triggers},
        "fields": {
            field.name: str(np.dtype(table.ARRAYS[field.name]))
            for field in dataclasses.fields(FaultSlot)
        },
        "forever": table.FOREVER_TICKS,
        **list_motions(planned),
        "programs": {
            "outcomes": _compile_program(
                tick, tick.without_signals(), shared_inputs=len(program.varied), width=wasm.WIDTH
            ),
            "replay": _replay_program(planned, tick),
            **action_programs,
        },
        "verdict": _verdict(planned, tick),
        "examples": _example_faults(planned),
        "worker": Path(__file__).with_name("static").joinpath("worker.js").read_text("utf-8"),
    }


def _effect(name: str) -> dict[str, Any]:
    """Return the code of an effect, and the channel and value of a network effect, else None."""
    network = EFFECTS[name].network
    # A network effect is another effect, which is injected at one channel.
    channel, injected_effect, value = network or (None, name, None)
    return {"code": EFFECT_CODES[injected_effect], "channel": channel, "constant": value}


def _example_faults(planned: Plan) -> list[dict[str, Any]]:
    """Return the first fault of each group: its site, channel, effect and so on, and its start."""
    faulty = planned.rows.loc[planned.rows["fault0_site"] != ""].drop_duplicates("group")
    names = {f"fault0_{name}": name for name in (*table.WORDS, "start_ms")}
    examples: pd.DataFrame = faulty[list(names)].rename(columns=names)
    return examples.to_dict("records")


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()


# --- motions, parameters, channels ---


def motion_name(config: CampaignConfig) -> str | None:
    """Return the name of the campaign's generated motion, or None if it is not generated."""
    operator = getattr(config, "operator", None)
    names = config.generated_motions()
    if operator is None or not names or operator.file is not None or operator.hands is not None:
        return None
    return operator.motion or names[0]


def list_motions(planned: Plan) -> dict[str, Any]:
    """Return the name of the campaign's motion ("" for a recording), and motions by name as base64.
    Further generated motions are included if all have at most MOTION_BYTES together.
    """
    campaign_motion = motion_name(planned.config)
    columns = {campaign_motion or "": planned.columns}
    names = planned.config.generated_motions() if campaign_motion is not None else ()
    if len(names) * sum(column.nbytes for column in planned.columns) <= MOTION_BYTES:
        for name in names:
            other = _motion_columns(planned, name) if name != campaign_motion else None
            if other is not None:
                columns[name] = other
    motions = {
        name: _base64(b"".join(column.tobytes() for column in motion_columns))
        for name, motion_columns in columns.items()
    }
    return {"motion": campaign_motion or "", "motions": motions}


def _motion_columns(planned: Plan, name: str) -> tuple[np.ndarray, ...] | None:
    """Return the columns of generated motion `name`; None if the robot would start elsewhere."""
    config, program = planned.config, planned.program
    operator = config.operator.model_copy(update={"motion": name})  # pyright: ignore[reportAttributeAccessIssue]
    other = config.model_copy(update={"operator": operator})
    # No parameter varies between runs here: {}.
    prepared = config.robot.part("campaign").prepare(
        other, {}, program.setup.injection, program.setup.precision
    )
    # The compiled program contains the robot's position at the start of the campaign's motion.
    campaign_params = dict(paths.path_leaves(program.params, program.setup))
    other_params = dict(paths.path_leaves(prepared.params, program.setup))
    for path, value in campaign_params.items():
        if path.startswith("start.") and not np.array_equal(value, other_params[path]):
            return None
    return tuple(np.ascontiguousarray(column) for column in prepared.columns)


def _parameter(planned: Plan, path: str) -> dict[str, Any]:
    """Return what the page needs to offer a parameter: value, type, unit, range and meaning."""
    program, robot = planned.program, planned.config.robot
    # The arms have the same value, and joints the same kind of range: the first is shown.
    value = next(iter(paths.named_numbers(program.params, program.setup, path).values()))
    quantity = next(iter(bounds.allowed_values(robot, path)), None)
    # Values of a parameter without a declared range.
    defaults = {"unit": "", "low": None, "high": None, "meaning": ""}
    dtype = planned.varied[path].dtype
    is_whole = dtype.kind != "f"
    return {
        "path": path,
        # The text of a float32 is its shortest decimal number, such as 0.1.
        "value": int(value) if is_whole else float(str(np.asarray(value, dtype)[()])),
        "type": str(dtype),
        "whole": is_whole,
        **{name: getattr(quantity, name, default) for name, default in defaults.items()},
    }


def _channels(planned: Plan) -> list[dict[str, Any]]:
    """Return the channels of the campaign's faults, each with the effects that a page may offer."""
    injection = planned.program.setup.injection
    site_effects = {use.site: list(use.effects) for use in injection.sites}
    rows = []
    for site, arm, channel in injection.channels:
        effects = site_effects[site]
        if site == "network":
            # A network effect acts at one channel. Other channels have the site's effects.
            network_effects = [
                name for name, injected in NETWORK_EFFECTS.items() if injected[0] == channel
            ]
            effects = network_effects or effects
        rows.append({"site": site, "arm": arm, "channel": channel, "effects": effects})
    return rows


def _verdict(planned: Plan, tick: TracedTick) -> dict[str, Any]:
    """Return the names, checks and rules from which the page derives the verdict of a run."""
    return {
        "responses": verdict.RESPONSES,
        "told": verdict.TOLD,
        "untold": verdict.UNTOLD,
        "hazards": verdict.HAZARDS,
        "cues": verdict.CUES,
        "halt_ms": verdict.HALT_MS,
        "checks": [
            {
                "name": check.name,
                "cause": check.named_cause,
                "response": check.response,
                "watches": check.action == "watch",
            }
            for check in map(planned.config.robot.check, checks.check_names(tick.outcomes))
        ],
        "failures": failures.CAUSES,
        "failure_of_tip": failures.CODES["tip"],
        "failure_of_outcome": failures.CODES["outcome"],
        "may_be_infinite": outcomes.MAY_BE_INFINITE,
        "cables": outcomes.cable_names(planned.config),
        "overload": outcomes.OVERLOAD,
        "golden_outcomes": schema.golden_outcomes(planned.shape),
    }


# --- programs ---


def _action_programs(planned: Plan) -> tuple[dict[str, int], dict[str, Any]]:
    """Return a number for each action of the robot, such as lifting the foot pedal, and the program
    "acted", which computes outcomes with an action. Both are empty for a robot without actions.
    """
    part = planned.config.robot.part("campaign")
    if not hasattr(part, "acted"):
        return {}, {}
    program, actions = part.acted(traced.printable_program(planned.program))
    # An action occupies an additional fault slot, which is empty (0) in the plan's [runs, slots].
    faults = {name: np.pad(values, ((0, 0), (0, 1))) for name, values in planned.faults.items()}
    plan = dataclasses.replace(planned, program=program, faults=faults)
    tick = traced.trace_tick(program, Block(*plan.lanes([0], 1), None), planned.columns)
    compiled = _compile_program(
        tick, tick.without_signals(), shared_inputs=len(program.varied), width=wasm.WIDTH
    )
    return actions, {"acted": compiled}


def _replay_program(planned: Plan, tick: TracedTick) -> dict[str, Any]:
    """Return the program that computes one run with its time series, for the animation."""
    outputs, signals = _series(planned, tick)
    step = tick.loop.step
    # The outputs of a tick are its states, the series of the golden run, and then the signals. Only
    # the signals of the time series are kept.
    first_signal = tick.loop.states + tick.series
    kept_signals = [step.outputs[first_signal + signal] for signal in signals]
    step = dataclasses.replace(step, outputs=(*step.outputs[:first_signal], *kept_signals))
    loop = dataclasses.replace(tick.loop, step=step)
    compiled = _compile_program(tick, loop, shared_inputs=len(planned.program.varied), width=1)
    return compiled | {"outputs": outputs}


def _series(planned: Plan, tick: TracedTick) -> tuple[list[dict[str, Any]], list[int]]:
    """Return rows that describe the time series of `words.toml`, and the numbers of the signals
    from which they are computed: each number of a series is a signal of the tick times a factor.

    To find signals and factors, the function computes the robot's series in one tick in which all
    signals are 0, and then in one tick for each signal, in which only this signal is 1. A multiple
    of one signal differs from zero in one of these ticks. The page computes other series itself.
    """
    dtypes = [np.dtype(dtype) for dtype in tree.tree_leaves(tick.signals)]
    probe_signals = [np.zeros(len(dtypes) + 1, dtype) for dtype in dtypes]
    for signal, values in enumerate(probe_signals):
        values[signal + 1] = 1
    probe_series = read_series(
        planned.config.robot,
        planned.program,
        tree.fill_tree(tick.signals, list(probe_signals)),
        np.zeros((len(dtypes) + 1, tick.series), np.float32),
    )
    rows, signals = [], []
    for name, values in probe_series.items():
        # [ticks of the probe, numbers of the series]
        flat = np.asarray(values, np.float64).reshape(len(dtypes) + 1, -1)
        of_one_signal = (np.count_nonzero(flat, axis=0) == 1) & (flat[0] == 0)
        is_shown = any(fnmatch.fnmatchcase(name, pattern) for pattern in WORDS["series"])
        if is_shown and of_one_signal.all():
            series_signals = np.argmax(flat[1:] != 0, axis=0).tolist()
            signals += series_signals
            rows.append(
                {
                    "name": name,
                    "shape": np.shape(values)[1:],
                    "types": [str(dtypes[signal]) for signal in series_signals],
                    # The only value that is not zero is the factor, in single precision.
                    "scales": [float(f"{number:.7g}") for number in flat.sum(axis=0)],
                }
            )
    return rows, signals


def _compile_program(
    tick: TracedTick, loop: TimeLoop, *, shared_inputs: int, width: int
) -> dict[str, Any]:
    """Return a program as WebAssembly, and the layout of the memory that it reads and writes. loop:
    the loop over the ticks, with the outputs that the program needs. width: robots side by side in
    a vector. shared_inputs: number of parameters, in which these robots do not differ.
    """
    kernel = print_kernel(split_lanes(loop, shared_inputs, grouped=True), width, wasm.FEATURES)
    program = {
        "outputs": [],
        "binary": _base64(wasm.emit_module(kernel.text, FUNCTIONS)),
        "width": width,
        "outcomes": tick.outcomes,
        "state_bytes": kernel.state.bytes,
        "group_state_bytes": kernel.group_state.bytes,
        "held_bytes": kernel.prologue.bytes,
        "row_bytes": kernel.row.bytes,
        "series": tick.series,
    }
    # Positions of the program's numbers in memory, in bytes.
    for name in ("inputs", "group_inputs", "results"):
        program[name] = dataclasses.asdict(getattr(kernel, name))
    return program
