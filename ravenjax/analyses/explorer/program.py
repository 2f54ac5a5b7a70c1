"""Compiles a campaign's tick to WebAssembly, and describes as JSON how a page runs it.

Numbers are in single precision or are 32-bit integers. Binaries and motions are little-endian words
in base64. `static/engine.js` reads the object of `describe_program`, with these keys:

- arms, ticks (ms of a run), cue (haptic set of the verdict), slots (faults of a run), observe_ms
- parameters: those that the page can change, in the order of a run's inputs
- channels: where faults act; the code of a fault is the channel's index in this list, from 1
- effects: code; a network effect also has the channel at which it is injected, the effect there and
  its value
- triggers, fields (types of a fault's numbers), forever (length of an endless window)
- motion, motions: the campaign's own, "" for a recording; float32 columns one after the other
- programs: outcomes, replay, and acted (outcomes with one more fault slot, for an action). Each is
  a module with the positions of its numbers in memory, in bytes. It imports
  env.__linear_memory only. width: robots side by side in a vector. series: numbers that a golden
  run stores in each tick, and a faulty run reads. outputs, of replay: words written in each tick
  after the series.
- actions: number of each action that `acted` can take; empty for a robot without actions
- harm_limit_mm: limit of motion after a stop, which is harm, too; null if the campaign defines harm
- verdict: the names of outcomes, and the response of each check
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

from ravenjax.bundled import resources
from ravenjax.campaign import outcomes, plan
from ravenjax.campaign.faults import table
from ravenjax.campaign.file import bounds
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.plan import Plan
from ravenjax.engines import traced
from ravenjax.engines.cpu.kernel import FUNCTIONS, print_kernel
from ravenjax.engines.interface import Block
from ravenjax.engines.traced import TracedTick
from ravenjax.engines.wasm import code
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
    """Return the campaign's plan with parameters that a page can change. Raises UserError."""
    ready = plan.make_plan(config)
    if config.campaign.noise:
        raise UserError("a page cannot draw noise for each run: set campaign.noise to false")
    if ready.tick_ms != 1:
        raise UserError(f"a page computes ticks of 1 ms, got a robot with {ready.tick_ms} ms")
    program = ready.program
    if not program.setup.injection.sites:
        raise UserError(
            f"campaign {config.campaign.name!r} has no fault, so a page has nothing to vary: add a"
            " [[group.fault]] to one of its groups; a page offers its site and effects"
        )
    # A page draws the lengths of packets once, not for each run.
    values = ready.varied | {key: 0 * ready.varied[key] for key in ready.keys}
    covered = {
        full for path in values for full in paths.named_numbers(program.params, program.setup, path)
    }
    for full, own in paths.path_leaves(program.params, program.setup):
        path = paths.without_arm(full, program.setup.arms)
        starts = [start for start in WORDS["parameters"] if f"{path}.".startswith(f"{start}.")]
        if not starts or full in covered:
            continue
        of_path = paths.named_numbers(program.params, program.setup, path)
        covered.update(of_path)
        dtype = program.setup.precision.real if np.asarray(own).dtype.kind == "f" else np.int32
        values[path] = np.full(ready.runs, own, dtype)
    # The page ends runs by itself, so the program needs only the triggers that a page offers.
    injection = program.setup.injection
    triggers = tuple(name for name in TRIGGER_CODES if name == "time" or name in injection.triggers)
    setup = dataclasses.replace(
        program.setup, injection=dataclasses.replace(injection, triggers=triggers)
    )
    program = dataclasses.replace(program, setup=setup, varied=tuple(values))
    return dataclasses.replace(
        ready, program=program, varied=values, golden=plan.number_golden_runs(values, ready.runs)
    )


def describe_program(config: CampaignConfig) -> dict[str, Any]:
    """Return the JSON object of a campaign, as the module docstring describes. Raises UserError."""
    ready = question_plan(config)
    program = ready.program
    printable = traced.printable_program(program)
    tick = traced.trace_tick(printable, Block(*ready.lanes([0], 1), None), ready.columns)
    shared = len(program.varied)
    actions, acted = _acted_program(ready)
    names = {f"fault0_{name}": name for name in (*table.WORDS, "start_ms")}
    faulty = ready.rows.loc[ready.rows["fault0_site"] != ""].drop_duplicates("group")
    examples: pd.DataFrame = faulty[list(names)].rename(columns=names)
    return {
        "actions": actions,
        "harm_limit_mm": config.outcomes.limit_mm if config.limit_counts else None,
        "arms": program.setup.arms,
        "ticks": program.ticks,
        "cue": config.outcomes.cue,
        "parameters": [_parameter(ready, path) for path in program.varied],
        "observe_ms": config.campaign.observe_ms,
        "slots": program.setup.injection.slots,
        "channels": _channels(ready),
        # A network effect is another effect on one channel.
        "effects": {
            name: {"code": EFFECT_CODES[plain], "channel": channel, "constant": constant}
            for name, effect in EFFECTS.items()
            for channel, plain, constant in [effect.network or (None, name, None)]
        },
        "triggers": {name: TRIGGER_CODES[name] for name in program.setup.injection.triggers},
        "fields": {
            field.name: str(np.dtype(table.ARRAYS[field.name]))
            for field in dataclasses.fields(FaultSlot)
        },
        "forever": table.FOREVER_TICKS,
        **list_motions(ready),
        "programs": {
            "outcomes": _printed(tick, tick.without_signals(), shared, code.WIDTH),
            "replay": _replay_program(ready, tick, shared),
            **acted,
        },
        "verdict": _verdict(config, tick),
        "examples": examples.to_dict("records"),
        "worker": Path(__file__).with_name("static").joinpath("worker.js").read_text("utf-8"),
    }


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


def list_motions(ready: Plan) -> dict[str, Any]:
    """Return the campaign's motion, and further motions if the page stays small enough."""
    own = motion_name(ready.config)
    columns = {own or "": ready.columns}
    if own is not None:
        names = ready.config.generated_motions()
        small = len(names) * sum(column.nbytes for column in ready.columns) <= MOTION_BYTES
        others = {name: _motion(ready, name) for name in names if small and name != own}
        columns |= {name: other for name, other in others.items() if other is not None}
    motions = {
        name: _base64(b"".join(column.tobytes() for column in of_name))
        for name, of_name in columns.items()
    }
    return {"motion": own or "", "motions": motions}


def _motion(ready: Plan, name: str) -> tuple[np.ndarray, ...] | None:
    # The columns of another generated motion; None if the robot would have to start elsewhere.
    config, own = ready.config, ready.program
    operator = config.operator.model_copy(update={"motion": name})  # pyright: ignore[reportAttributeAccessIssue]
    other = config.model_copy(update={"operator": operator})
    prepared = config.robot.part("campaign").prepare(
        other, {}, own.setup.injection, own.setup.precision
    )
    here, there = (
        dict(paths.path_leaves(params, own.setup)) for params in (own.params, prepared.params)
    )
    if any(
        not np.array_equal(here[path], there[path]) for path in here if path.startswith("start.")
    ):
        return None
    return tuple(np.ascontiguousarray(column) for column in prepared.columns)


def _parameter(ready: Plan, path: str) -> dict[str, Any]:
    # Returns what the page needs to offer a parameter: its value, its type and its range.
    program, robot = ready.program, ready.config.robot
    own = next(iter(paths.named_numbers(program.params, program.setup, path).values()))
    limits = next(iter(bounds.allowed_values(robot, path)), None)
    unknown = {"unit": "", "low": None, "high": None, "meaning": ""}
    dtype = ready.varied[path].dtype
    return {
        "path": path,
        "value": float(str(np.asarray(own, dtype)[()])) if dtype.kind == "f" else int(own),
        "type": str(dtype),
        "whole": dtype.kind != "f",
        **{name: getattr(limits, name, default) for name, default in unknown.items()},
    }


def _channels(ready: Plan) -> list[dict[str, Any]]:
    # Returns the channels of the campaign's faults, each with the effects that the page may offer.
    injection = ready.program.setup.injection
    effects = {use.site: use.effects for use in injection.sites}
    rows = []
    for site, arm, name in table.injection_targets(injection):
        of_channel = [
            effect
            for effect, stands in NETWORK_EFFECTS.items()
            if site == "network" and stands[0] == name
        ]
        offered = of_channel or list(effects[site])
        rows.append({"site": site, "arm": arm, "channel": name, "effects": offered})
    return rows


def _verdict(config: CampaignConfig, tick: TracedTick) -> dict[str, Any]:
    # Returns the names, checks and rules from which the page derives the verdict of a run.
    robot = config.robot
    rules = [robot.check(name) for name in checks.check_names(tick.outcomes)]
    words = ("responses", "told", "untold", "hazards", "cues", "halt_ms")
    return {name: getattr(verdict, name.upper()) for name in words} | {
        "checks": [
            {
                "name": check.name,
                "cause": check.named_cause,
                "response": check.response,
                "watches": check.action == "watch",
            }
            for check in rules
        ],
        "failures": failures.CAUSES,
        "failure_of_tip": failures.CODES["tip"],
        "failure_of_outcome": failures.CODES["outcome"],
        "may_be_infinite": outcomes.MAY_BE_INFINITE,
        "cables": outcomes.cable_names(config),
        "overload": schema.OVERLOAD,
        "kept_of_golden": [name for name in tick.outcomes if schema.kept_of_golden(name)],
    }


# --- programs ---


def _acted_program(ready: Plan) -> tuple[dict[str, int], dict[str, Any]]:
    # Returns the numbers of the robot's actions, and a program that takes one of them at a tick.
    part = ready.config.robot.part("campaign")
    if not hasattr(part, "acted"):
        return {}, {}
    program, actions = part.acted(traced.printable_program(ready.program))
    faults = {name: np.pad(values, ((0, 0), (0, 1))) for name, values in ready.faults.items()}
    plan = dataclasses.replace(ready, program=program, faults=faults)
    tick = traced.trace_tick(program, Block(*plan.lanes([0], 1), None), ready.columns)
    shared = len(program.varied)
    return actions, {"acted": _printed(tick, tick.without_signals(), shared, code.WIDTH)}


def _replay_program(ready: Plan, tick: TracedTick, shared: int) -> dict[str, Any]:
    # Returns the program that computes one run with its time series, for the animation.
    outputs, signals = _series(ready, tick)
    step, first = tick.loop.step, tick.loop.states + tick.series
    leaves = [step.outputs[first + signal] for signal in signals]
    loop = dataclasses.replace(
        tick.loop, step=dataclasses.replace(step, outputs=(*step.outputs[:first], *leaves))
    )
    return _printed(tick, loop, shared, 1) | {"outputs": outputs}


def _series(ready: Plan, tick: TracedTick) -> tuple[list[dict[str, Any]], list[int]]:
    """Return the time series of `words.toml`, with the signal and the factor of each number.

    The function computes the robot's series for signals of which one at a time is 1. A number that
    is a multiple of one signal then differs from zero once. Numbers that depend on several signals
    are left out; the page computes them itself.
    """
    dtypes = [np.dtype(dtype) for dtype in tree.tree_leaves(tick.signals)]
    probe = [np.zeros(len(dtypes) + 1, dtype) for dtype in dtypes]
    for leaf, values in enumerate(probe):
        values[leaf + 1] = 1
    named = read_series(
        ready.config.robot,
        ready.program,
        tree.fill_tree(tick.signals, list(probe)),
        np.zeros((len(dtypes) + 1, tick.series), np.float32),
    )
    rows, signals = [], []
    for name, values in named.items():
        flat = np.asarray(values, np.float64).reshape(len(dtypes) + 1, -1)
        alone = (np.count_nonzero(flat, axis=0) == 1) & (flat[0] == 0)
        if alone.all() and any(fnmatch.fnmatchcase(name, pattern) for pattern in WORDS["series"]):
            leaves = np.argmax(flat[1:] != 0, axis=0).tolist()
            signals += leaves
            rows.append(
                {
                    "name": name,
                    "shape": np.shape(values)[1:],
                    "types": [str(dtypes[leaf]) for leaf in leaves],
                    "scales": [float(f"{number:.7g}") for number in flat.sum(axis=0)],
                }
            )
    return rows, signals


def _printed(tick: TracedTick, loop: TimeLoop, shared: int, width: int) -> dict[str, Any]:
    # Returns a program as WebAssembly, and the layout of the memory that it reads and writes.
    kernel = print_kernel(split_lanes(loop, shared, grouped=True), width, code.FEATURES)
    return {
        "outputs": [],
        "binary": _base64(code.emit_module(kernel.text, FUNCTIONS)),
        "width": width,
        "outcomes": tick.outcomes,
        "state_bytes": kernel.state.bytes,
        "group_state_bytes": kernel.group_state.bytes,
        "held_bytes": kernel.prologue.bytes,
        "row_bytes": kernel.row.bytes,
        "series": tick.series,
    } | {
        name: dataclasses.asdict(getattr(kernel, name))
        for name in ("inputs", "group_inputs", "results")
    }
