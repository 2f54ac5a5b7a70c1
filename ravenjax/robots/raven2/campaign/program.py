"""Builds a Raven's tick for a checked campaign, with its settings, parameters and motion."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ravenjax.campaign.prepared import Prepared, shared_choices, shared_parameters
from ravenjax.engines.interface import TickProgram
from ravenjax.numbers import paths, replace
from ravenjax.numbers.setup import Injection, Precision
from ravenjax.robots.raven2.campaign import hands
from ravenjax.robots.raven2.campaign.config import RavenConfig
from ravenjax.robots.raven2.console import reaction
from ravenjax.robots.raven2.console.motion import Motion
from ravenjax.robots.raven2.loop import run
from ravenjax.robots.raven2.loop.records import TickParams
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import overdrive
from ravenjax.stages import acted
from ravenjax.vocabulary import packets
from ravenjax.vocabulary.reactions import ACTIONS

NOISE_KEY = "plant.noise_key"
"""Random key of the noise. A campaign sets it from the run's id, so each run has its own noise."""
PACKETS, PACKET_KEY = "network.packets", "network.packet_key"
"""Parameter that makes the tick draw packet lengths, and the draws' key, from the run's id."""
DELAY, LONGEST_DELAY = "usb.command_delay", 16
"""Parameter that delays commands, and the longest delay for which the tick stores commands, ms."""
SETUP_KEYS = ("software", "build", "console", "substeps", "cables", "noise")
"""Keys of [campaign] that are fields of `RavenSetup`."""
SCALE = "operator.scale"
"""Parameter of the teleoperation scale."""


def prepare_campaign(
    config: RavenConfig, varied: Mapping[str, Any], injection: Injection, precision: Precision
) -> Prepared:
    """Return the options, parameters and operator's motion of a campaign.
    varied: path of a parameter that differs between runs -> its values [runs]. Raises UserError if
    the operator's file cannot be used.
    """
    replay = hands.operator_replay(config)
    motion = hands.operator_motion(config) if replay is None else replay.motion
    setup = RavenSetup(
        **{name: getattr(config.campaign, name) for name in SETUP_KEYS},
        **shared_choices(config, injection, precision),
        tools=config.tools,
        dac_words=config.campaign.dac_words or "wrap",
        controller=() if config.controller is None else tuple(config.controller.parts()),
        hands=config.operator.own,
        packets=_packet_shares(config, varied.get(PACKETS)),
        packet_history=config.packet_history,
        # The longest delay of all runs; NaN: a run without a value
        command_delay=int(np.nan_to_num(varied.get(DELAY, 0)).clip(0, LONGEST_DELAY).max()),
        checks=tuple(check.use for check in config.check),
    )
    return Prepared(
        loop=run,
        setup=setup,
        params=_params(config, setup, motion),
        columns=tuple(motion.table().T),
        motion=motion,
        operator=None if replay is None else hands.summarize_replay(replay, varied.get(SCALE)),
        # Parameter that gets a random key in each run -> what the key is for
        keys=({NOISE_KEY: "noise"} if setup.noise else {})
        | ({PACKET_KEY: "packets"} if setup.packets else {}),
    )


def _packet_shares(
    config: RavenConfig, choices: np.ndarray | None
) -> tuple[tuple[float, ...], ...]:
    # Returns the built-in distributions of packet lengths, then the file's; () if no run draws
    # lengths. choices: index of each run's built-in distribution [runs]; NaN or None: the file's.
    shares = config.campaign.packet_shares
    # Index 0, a packet in every cycle, draws nothing. For NaN (0 here), `shares` decides below
    some_run_draws = choices is not None and np.nan_to_num(choices).any()
    if some_run_draws or shares != packets.SHARES[packets.EVERY_CYCLE]:
        return (*packets.SHARES, shares)
    return ()


def _params(config: RavenConfig, setup: RavenSetup, motion: Motion) -> TickParams:
    # Returns the tick's parameters with every value that the file sets.
    params = run.params(setup, motion.start_jpos, config.campaign.parameter_set)
    policy = overdrive.POLICIES.index(config.campaign.policy)
    limits = overdrive.params(setup, config.campaign.level, policy)
    control = replace(params.control, overdrive=limits)
    stages = dict(params.stages)
    if setup.detectors:
        thresholds = tuple(thresholds for _, _, thresholds in config.detectors)
        stages["detectors"] = replace(stages["detectors"], thresholds=thresholds)
    params = replace(params, control=control, stages=stages, **shared_parameters(config))
    for path, value in _file_values(config).items():
        params = paths.assign_numbers(params, setup, path, value)
    return params


def _file_values(config: RavenConfig) -> dict[str, Any]:
    # Returns the values of the robot's sections in SI units, by path of the tick's parameters.
    values: dict[str, Any] = {
        SCALE: config.operator.scale,
        PACKETS: np.int32(config.campaign.packet_choice),
        **{f"checks.threshold.{check.name}": check.threshold for check in config.check},
    }
    if config.campaign.kinematic_errors == "measured":
        values["plant.kinematic_errors.registered"] = np.int32(1)
    # The sections of optional stages
    sections = config.model_dump(include={*config.stages})
    if numbers := sections.get("reaction"):
        numbers["action"] = np.int32(ACTIONS.index(numbers["action"]))
        numbers["correct_speed"] = numbers.pop("correct_mm_s") / 1e3  # m/s
    for stage, numbers in sections.items():
        values |= {f"{stage}.{name}": number for name, number in numbers.items()}
    for joint, limits in config.limits.si().items():
        for side, value in zip(("lower", "upper"), limits, strict=True):
            # The software stores its limits as float32
            values[f"control.cartesian.{side}.{joint}"] = float(np.float32(value))
            values[f"nominal.target.{side}.{joint}"] = value
    return values


def add_action(program: TickProgram) -> tuple[TickProgram, dict[str, int]]:
    """Return the program of the same runs with a fault slot for an action (`stages.acted`), and the
    number of each action in this slot. A user's file in place of the operator decides about the
    pedal itself, so there is then no action `pedal`.
    """
    setup, params = program.setup, program.params
    # An action needs the code of an operator who reacts, and of commands that are delayed
    stages = tuple(dict.fromkeys((*setup.stages, "reaction")))
    setup = replace(setup, stages=stages, command_delay=max(1, setup.command_delay))
    params = replace(params, stages={"reaction": reaction.ReactionParams(), **params.stages})
    program, actions = acted.add_action(replace(program, setup=setup, params=params))
    # `hands` is the user's file
    if setup.hands is not None:
        del actions["pedal"]
    return program, actions
