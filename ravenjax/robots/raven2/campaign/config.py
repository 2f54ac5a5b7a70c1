"""A whole campaign file of a Raven-II: its sections, and the properties that follow from them."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import model_validator

from ravenjax import resources
from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import ALL, Fault, Group, Run
from ravenjax.campaign.file.location import Complaint
from ravenjax.errors import UserError, suggest_unit
from ravenjax.parts import part
from ravenjax.robots.raven2.campaign.sections import (
    Hand,
    Limits,
    Operator,
    OwnStages,
    RavenCampaign,
    Reaction,
)
from ravenjax.robots.raven2.console.motions import MOTIONS
from ravenjax.robots.raven2.geometry.tools import DEFAULT_TOOLS
from ravenjax.robots.raven2.plant.kinematic_errors import MEASURED
from ravenjax.stages.channel import DELAY_MS, JITTER_MS
from ravenjax.vocabulary import packets
from ravenjax.vocabulary.effects import NETWORK_EFFECTS
from ravenjax.vocabulary.parts import OwnSource
from ravenjax.vocabulary.reactions import ACTIONS, MEANINGS

HEALTHY_MM = 0.1
"""Distance from the nominal model that every moving robot exceeds without a fault, mm."""
REACH_MM = 429.0
"""Longest distance between two tip positions within the hard stops of joints 1 to 3, mm."""
FASTEST_MS = 80.0
"""Delay of a reaction that is shorter than any person's reaction to touch, ms."""
_REACTION = resources.read_tables(__file__, "reaction.toml")
USING_ACTIONS: dict[str, list[str]] = _REACTION["read_by"]
"""Parameter of a reaction -> the actions that use the parameter."""
NEUTRAL_VALUES: dict[str, float] = _REACTION["idle"]
"""Parameter of a reaction -> the value with which the action has no effect."""


class RavenConfig(CampaignConfig):
    """A whole campaign file of a Raven-II."""

    campaign: RavenCampaign
    operator: Operator = Operator(motion="suture")
    limits: Limits = Limits()
    reaction: Reaction | None = None
    """an operator who reacts to the haptic cue; without this section, nobody reacts"""
    controller: OwnStages | None = None
    """your own files as stages of the control software"""
    hand: Hand | None = None
    """a hand that the cue moves; without this section, the cue moves no hand"""
    changeable: ClassVar[str] = r"(control|plc|plant(?!.*\.kinematic_errors))\."
    without_effect: ClassVar[dict[str, str]] = {
        "control.overdrive.dac_max.grasp2": "the original's overdrive check ignores grasp2"
    }

    @model_validator(mode="after")
    def _add_error_parameters(self) -> RavenConfig:
        # Adds a normal distribution for each kinematic error of each arm to the parameters. Only
        # with kinematic_errors = 'measured'. An error that the file already sets in [parameters] or
        # varies in a [cross] keeps the values of the file.
        if self.campaign.kinematic_errors == "measured":
            set_paths = self.cross.keys() | self.parameters.keys()
            set_paths |= {path for group in self.group for path in group.cross}
            for arm in self.campaign.arms:
                for error, deviation in MEASURED.items():
                    path = f"plant.{arm}.kinematic_errors.{error}"
                    if path not in set_paths:
                        self.parameters[path] = Axis("normal", (0.0, deviation))
        return self

    def with_files(self, folder: Path) -> CampaignConfig:
        """Return a copy in which the paths of the user's files, which are relative to `folder`, are
        absolute. Raises UserError if a file cannot be used.
        """
        new = super().with_files(folder)
        if self.controller is not None:
            new = new.model_copy(update={"controller": self.controller.locate_files(folder)})
        return new.model_copy(update={"operator": self.operator.locate_files(folder)})

    def own_parts(self) -> Iterator[tuple[str, OwnSource]]:
        """Yield (first part of the paths of its parameters, code) for each Python file of the user.
        Raises UserError if a file is unusable.
        """
        yield from super().own_parts()
        if self.controller is not None:
            for stage, source in self.controller.parts():
                yield f"control.own.{stage}", source
        if (hands := self.operator.own) is not None:
            yield "operator.own.hands", hands

    @property
    def tools(self) -> tuple[str, ...]:
        """Tool names, one per arm: those of the file, or the defaults of the control software."""
        defaults = DEFAULT_TOOLS[self.campaign.software]
        return self.campaign.tools or tuple(defaults[arm] for arm in self.campaign.arms)

    @property
    def operator_label(self) -> str:
        """Name of the motion in tables."""
        return self.operator.label

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield (heading, text) for each line that describes the settings of the campaign."""
        yield from super().lines()
        operator = self.operator
        motion = f"{operator.file}, recorded" if operator.file else f"{operator.label}, generated"
        hands = "" if operator.hands is None else f"; hands moved by {operator.hands}"
        hand = "" if self.hand is None else f"; the cue moves the hand, grip {self.hand.grip:g}"
        if self.campaign.contact:
            yield "contact", "of jaw tips with tissue and vessel, of instruments with each other"
        if self.controller is not None:
            files = (f"{stage}: {file}" for stage, file in self.controller.files())
            yield "controller", ", ".join(files)
        timing = ""
        if self.random_packets:
            timing = f"; on average {self.cycles_a_packet:.3g} control cycles per packet"
        scale = f"; scale {operator.scale:g}"
        yield "operator", f"{motion}{hands}{scale}{timing}{self._describe_reaction()}{hand}"

    def _describe_reaction(self) -> str:
        # Describes the operator's reaction to the cue in words.
        if self.reaction is None:
            return ""
        variation = "as reaction.action varies, or " * ("reaction.action" in self.axes_by_path)
        return f"; at the cue: {variation}{MEANINGS[self.reaction.action]}"

    def settings(self) -> dict[str, Any]:
        """Return the settings that `lines` describes, as JSON."""
        return super().settings() | {
            "software": self.campaign.software,
            "operator": self.operator.model_dump(mode="json", exclude_none=True),
            **self.model_dump(mode="json", include={"reaction", "hand"}),
        }

    def generated_motions(self) -> tuple[str, ...]:
        """Return the names of the motions that the robot can generate."""
        return tuple(MOTIONS)

    def notices(self) -> Iterator[Complaint]:
        """Yield (key, message) for settings without effect, and for values that may be mistakes."""
        yield from super().notices()
        for name, section in (("operator.start", self.operator.start), ("limits", self.limits)):
            for key, angle in section.model_dump(exclude_none=True).items():
                largest = float(np.max(np.abs(angle)))
                if key.endswith("_deg") and 0 < largest <= math.pi:
                    yield (name, key), f"got {angle} degrees{suggest_unit(key, angle)}"
        axes = self.axes_by_path
        errors = [path for path in axes if ".kinematic_errors." in path]
        only_scales = all(path.endswith(".scale") for path in errors)
        measured = self.campaign.kinematic_errors == "measured"
        for path in errors:
            key = ("parameters", path)
            if not measured and only_scales:
                yield key, "has no effect while campaign.kinematic_errors is 'none'"
            if measured and path.endswith(".scale") and axes[path].values == (0,):
                message = "the value 0 removes the errors of campaign.kinematic_errors = 'measured'"
                yield key, message
        delay_ms = 250.0 if self.reaction is None else self.reaction.delay_ms
        if 0 < delay_ms < FASTEST_MS:
            unit = suggest_unit("delay_ms", delay_ms, FASTEST_MS)
            yield ("reaction", "delay_ms"), f"got {delay_ms:g}, faster than any person{unit}"
        if self.operator.motion == "still" and self.operator.seed:
            yield ("operator", "seed"), "motion 'still' is the same for every seed"
        if self.operator.place == "home" and self.operator.offset_mm is not None:
            message = "has no effect with place = 'home', which moves the tip to the home pose"
            yield ("operator", "offset_mm"), message
        starts = self.operator.start.jpos()
        for joint, (low, high) in self.limits.si().items():
            if self.operator.file is None and not low <= starts[joint] <= high:
                yield ("operator", "start"), f"{joint} starts outside its range in [limits]"
        sites = {
            fault.site
            for group in self.group
            for run in group.run or (Run(),)
            for fault in group.faults_of(run)
        }
        if self.campaign.dac_words is not None and "usb_out" not in sites:
            yield ("campaign", "dac_words"), "has no effect without a fault at site usb_out"

    def notices_of_runs(self, plan: Any) -> Iterator[tuple[str, np.ndarray, str]]:
        """Yield (key, runs, message) for each key whose value has no effect in some runs of a plan.
        runs: whether the value has no effect in each run, bool [runs].
        """
        paths = self.axes_by_path.keys()
        group_of_run = plan.rows["group"].cat.codes.to_numpy()

        def is_unused_in_group(uses: np.ndarray) -> np.ndarray:
            # Returns for each run whether no run of its group uses a key, bool [runs].
            # uses: for each run whether it uses the key, bool [runs].
            return ~np.isin(group_of_run, group_of_run[uses])

        if self.campaign.software == "raven2":
            varies_limits = any(path.startswith("control.overdrive.dac_max") for path in paths)
            # A safety level sets the limits `dac_max` of all joints.
            key = "campaign.level" if self.campaign.level else "control.overdrive.dac_max"
            if self.campaign.level or varies_limits:
                # Policy 0 is 'no_regulation'.
                uses_limits = plan.numbers("control.overdrive.policy") != 0
                message = "has no effect with policy 'no_regulation', which ignores these limits"
                yield key, is_unused_in_group(uses_limits), message
        if self.detector and "detectors.armed_after" in paths:
            late = plan.numbers("detectors.armed_after") >= plan.ends
            yield "detectors.armed_after", late, "no detector becomes active before the run ends"
        if self.hand is not None:
            message = "with 0 N per device unit the cue moves no hand"
            yield "hand.newtons_per_unit", plan.numbers("hand.newtons_per_unit") == 0, message
        if self.reaction is not None:
            yield from self._reaction_notices(plan, paths, is_unused_in_group)

    def _reaction_notices(
        self, plan, paths: Collection[str], is_unused_in_group: Callable[[np.ndarray], np.ndarray]
    ) -> Iterator[tuple[str, np.ndarray, str]]:
        # Yields (key, which runs, message) for values of [reaction] without effect.
        # is_unused_in_group: bool [runs], the run uses a key -> no run of its group uses the key.
        written = {
            # The parameter in m/s has another name than the key in mm/s
            "correct_speed" if name == "correct_mm_s" else name
            for name, field in Reaction.model_fields.items()
            if getattr(self.reaction, name) != field.default
        }
        numbers = {name: plan.numbers(f"reaction.{name}") for name in USING_ACTIONS}
        action = np.array(ACTIONS)[plan.numbers("reaction.action")]
        for name, actions in USING_ACTIONS.items():
            uses = np.isin(action, actions)
            if name in written or f"reaction.{name}" in paths:
                unused = is_unused_in_group(uses)
                yield f"reaction.{name}", unused, "has no effect with this reaction.action"
            if (neutral := NEUTRAL_VALUES.get(name)) is not None:
                message = f"with {neutral:g} the action has no effect"
                yield f"reaction.{name}", uses & (numbers[name] == neutral), message
        # The operator feels the first haptic set
        acts, cap = action != "none", self.haptics.cues()[0].cap
        force = numbers["felt_force"]
        message = f"{force.max():g} device units are never reached: the cue's cap is {cap:g}"
        yield "reaction.felt_force", acts & (force > np.float32(cap)), message
        # Ticks from the first possible cue to the end. Without a fault, a cue may come at any time
        has_fault = (plan.faults["code"] > 0).any(axis=1) & (plan.acts < plan.ends)
        ticks_left = plan.ends - np.where(has_fault, plan.acts, 0)
        message = "the delay is so long that the run ends before the operator acts"
        yield "reaction.delay_ms", acts & (numbers["delay_ms"] >= ticks_left), message

    @property
    def distances_mm(self) -> tuple[float, float]:
        """Distance from the nominal model without a fault, and largest possible distance, mm."""
        return HEALTHY_MM, REACH_MM

    def complaints(self) -> Iterator[Complaint]:
        """Yield (key, message) for each mistake in the file, those of the Raven-II last."""
        yield from super().complaints()
        hands = self.operator.hands
        if hands is not None and self.reaction is not None:
            yield (
                ("reaction",),
                f"[reaction] is for the built-in operator, but operator.hands is {hands}. Remove"
                " [reaction] and react in the file (view.arms has the cue's force), or remove"
                " operator.hands",
            )
        if self.operator.motion == "clutched" and self.campaign.console == "absolute":
            yield (
                ("operator", "motion"),
                "got 'clutched', expected campaign.console = 'increments', because a console that"
                " sends absolute positions has no clutch",
            )
        for key, table in self.parameter_tables():
            choice = table.get("network.packets")
            if choice and packets.OWN in choice.values and isinstance(self.campaign.packets, str):
                yield (
                    (*key, "network.packets"),
                    f"got {packets.OWN}, which selects the shares in campaign.packets, but"
                    " campaign.packets has no shares: write a list of shares there",
                )
            if "network.cycles_per_packet" in table and self.random_packets:
                yield (
                    (*key, "network.cycles_per_packet"),
                    "has no effect where the lengths of packets are drawn: remove this"
                    " parameter. For n cycles per packet, write campaign.packets = [0, .., 1] with"
                    " n numbers",
                )
        for g, group in enumerate(self.group):
            longest = self.longest_packet if self.random_packets else 1
            age = min(_oldest_packet_ms((group,), longest), self.campaign.ticks)
            # The tick does not store packets for this site, but computes an older packet from the
            # plan, which the hands of a user's file may have left
            if hands is not None and age > 0:
                yield (
                    ("group", g),
                    "faults at site 'network' may send older packets, which are computed from the"
                    f" plan, but operator.hands is {hands}, which may have left the plan. Remove"
                    " operator.hands, or use faults that lose packets (effect 'drop', channels"
                    " lost and bursts)",
                )
            if self.random_packets and age > LONGEST_HISTORY_MS:
                yield (
                    ("group", g),
                    f"faults at site 'network' may send packets that are {age:.0f} ms old,"
                    f" expected at most {LONGEST_HISTORY_MS} ms where the lengths of packets are"
                    " drawn. Write smaller values of these faults, a shorter campaign.duration_s,"
                    ' or campaign.packets = "every_cycle"',
                )

    @property
    def random_packets(self) -> bool:
        """Whether the length of packets is drawn in some run: in distributions other than 0."""
        return self.campaign.packet_choice != packets.EVERY_CYCLE or any(
            any(axis.values) for axis in self._packet_axes
        )

    @property
    def _packet_axes(self) -> list[Axis]:
        name = "network.packets"
        return [table[name] for _, table in self.parameter_tables() if name in table]

    @property
    def packet_history(self) -> int:
        """Age in ms of the oldest packet that a network fault may send again; 0: none. Only for
        packets with drawn lengths; 0 without them.
        """
        if not self.random_packets:
            return 0
        return int(min(_oldest_packet_ms(self.group, self.longest_packet), self.campaign.ticks))

    @property
    def longest_packet(self) -> int:
        """Largest number of cycles that a packet may last, if lengths are drawn."""
        distributions = [self.campaign.packet_shares]
        if self._packet_axes:  # runs may have other distributions
            distributions += packets.SHARES
        return max(map(len, distributions))

    @property
    def cycles_a_packet(self) -> float:
        """Mean number of cycles per packet; 1, the smallest, if the mean differs between runs."""
        return 1.0 if self._packet_axes else packets.mean_cycles(self.campaign.packet_shares)

    def allows_beyond_16_bits(self, fault: Fault) -> bool:
        """Return whether the file states how the fault's values beyond 16 bits are stored. The
        fault's key `wraps` states this, or, at site usb_out, the key campaign.dac_words.
        """
        return super().allows_beyond_16_bits(fault) or (
            fault.site == "usb_out" and self.campaign.dac_words is not None
        )

    def deciding(self) -> dict[str, Any]:
        """Return the settings on which the outcomes of all runs depend, for the hash of run ids.
        Defaults are left out, except for tools and limits. Of each file it contains a hash.
        """
        content = super().deciding()
        campaign = content["campaign"]
        if campaign.get("dac_words") == "wrap":  # same as without the key
            del campaign["dac_words"]
        file_keys = {"file", "hands", "hands_sha256"}
        operator = self.operator.model_dump(mode="json", exclude=file_keys, exclude_defaults=True)
        if self.operator.file is not None:
            try:
                with open(self.operator.file, "rb") as file:
                    operator["file"] = hashlib.file_digest(file, "sha256").hexdigest()
            except OSError as error:
                raise UserError(
                    f"{self.operator.file}: operator.file cannot be read ({error.strerror})"
                ) from None
        if (hands := self.operator.own) is not None:
            operator["hands"] = part.hash_source(hands)
        sections = {
            "campaign": {**campaign, "tools": self.tools},
            "operator": operator,
            "limits": self.limits.si(),
            **self.model_dump(mode="json", include={"hand"}, exclude_none=True),
        }
        if self.controller is not None:
            parts = self.controller.parts()
            sections["controller"] = {stage: part.hash_source(source) for stage, source in parts}
        return content | sections


LONGEST_HISTORY_MS = 8192
"""Age in ms of the oldest packet that a network fault may send again, if packet lengths are drawn.

The tick then stores which of the last 8 192 cycles had a packet: 256 words, which cost 9 000
operations per tick. The rest of a tick needs 11 400. Without draws nothing is stored, because the
number of a packet determines the tick in which it was sent.
"""


def _oldest_packet_ms(groups: Iterable[Group], longest_packet: int) -> float:
    # Returns the age in ms of the oldest packet that network faults may send again in any run. The
    # age is 0 if no packet is sent again, and infinite if it has no bound; see `_age_ms`.
    runs = (run for group in groups for run in (group.fault, *map(group.faults_of, group.run)))
    return max((_age_ms(faults, longest_packet) for faults in runs), default=0.0)


def _age_ms(faults: Iterable[Fault], longest_packet: int) -> float:
    # Returns the age in ms of the oldest packet that the faults of one run may send again.
    # longest_packet: largest number of cycles (ms) that a packet lasts.
    network_faults = [fault for fault in faults if fault.site == "network"]
    delays = [delay for fault in network_faults if (delay := _longest_delay(fault)) is not None]
    has_jitter = any("jitter" in _network_channels(fault) for fault in network_faults)
    if not delays and not has_jitter:
        return 0.0
    # The delays of several faults, in packets, add up. Add one packet for the age of the newest
    # packet, and one because a packet contains the motion since the packet before it. DELAY_MS[1]
    # and JITTER_MS[1] are the longest delays of a channel with jitter, which also add up
    age = (sum(delays) + 2) * longest_packet
    return age + math.ceil(DELAY_MS[1] + JITTER_MS[1]) if has_jitter else age


def _longest_delay(fault: Fault) -> float | None:
    """Return the longest delay by a network fault, in packets; None if it delays no packets."""
    if not _network_channels(fault) & {"lag", "delay"}:
        return None
    longest = 0.0
    for name in fault.effect.listed:
        # A network effect stands for an effect with a fixed value; other effects for themselves
        _, effect, fixed_value = NETWORK_EFFECTS.get(name, ("", name, None))
        if effect == "stuck":  # holds the delay that other faults cause, and adds none
            continue
        # With any other effect, the sum of delays of several faults has no known bound
        if effect not in ("overwrite", "offset", "latch_offset", "periodic", "random", "toggle"):
            return math.inf
        # All values of a list, or the bounds of a distribution
        values = () if fault.value is None else fault.value.listed or fault.value.extent
        if fixed_value is not None:
            values = (fixed_value,)
        longest = max([longest, *map(abs, values)])
    return longest


def _network_channels(fault: Fault) -> set[str]:
    # Returns the channels of a network fault. Effects on packets, such as drop, imply a channel.
    implied = {
        NETWORK_EFFECTS[name].channel for name in fault.effect.listed if name in NETWORK_EFFECTS
    }
    listed = () if fault.channel is None else fault.channel.listed
    return implied | ({"lag", "delay", "jitter"} if ALL in listed else set(listed))


def require_raven(config: CampaignConfig) -> RavenConfig:
    """Return `config`, typed as a Raven-II's campaign. Raises UserError for another robot."""
    if not isinstance(config, RavenConfig):
        raise UserError(
            f"campaign.robot is {config.campaign.robot!r}, expected 'raven2', because this command"
            " works for a Raven-II only"
        )
    return config
