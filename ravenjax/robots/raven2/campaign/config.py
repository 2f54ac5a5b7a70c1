"""A whole campaign file of a Raven-II: its sections, and the properties that follow from them."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import model_validator

from ravenjax.bundled import resources
from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.file.group import ALL, Fault, Group, Run
from ravenjax.campaign.file.location import Complaint
from ravenjax.errors import UserError, suggest_unit
from ravenjax.parts import part
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.robots.raven2.campaign.sections import (
    Hand,
    Limits,
    Operator,
    OwnStages,
    RavenCampaign,
    Reaction,
)
from ravenjax.robots.raven2.console.motions import MOTIONS
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.geometry.tools import DEFAULT_TOOLS
from ravenjax.robots.raven2.plant import parameter_sets
from ravenjax.robots.raven2.plant.kinematic_errors import MEASURED
from ravenjax.stages.channel import DELAY_MS, JITTER_MS
from ravenjax.vocabulary import packets
from ravenjax.vocabulary.effects import NETWORK_EFFECTS
from ravenjax.vocabulary.parts import OwnSource
from ravenjax.vocabulary.reactions import ACTIONS, MEANINGS

HEALTHY_MM = 0.1
"""Below the distance of any fault-free moving robot from its nominal model (0.6 to 1.8 mm)."""
REACH_MM = 429.0
"""Longest distance between two tip positions within the hard stops of joints 1 to 3."""
FASTEST_MS = 80.0
"""Shorter than any person's reaction to touch."""
_REACTION = resources.read_tables(__file__, "reaction.toml")
READ_BY: dict[str, list[str]] = _REACTION["read_by"]
"""Parameter of a reaction -> the actions that use the parameter."""
IDLE: dict[str, float] = _REACTION["idle"]
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

    @model_validator(mode="after")
    def _draw_errors(self) -> RavenConfig:
        """Add the parameters of kinematic errors, which are drawn, after those of the file."""
        if self.campaign.kinematic_errors == "measured":
            crossed = self.cross.keys() | {path for group in self.group for path in group.cross}
            axes = {
                f"plant.{arm}.kinematic_errors.{path}": Axis("normal", (0.0, deviation))
                for arm in self.campaign.arms
                for path, deviation in MEASURED.items()
            }.items()
            self.parameters.update(
                {p: axis for p, axis in axes if p not in crossed | self.parameters.keys()}
            )
        return self

    def with_files(self, folder: Path) -> CampaignConfig:
        """Return the configuration with recorded operator and users' files read from `folder`.

        Raises UserError.
        """
        new = super().with_files(folder)
        if self.controller is not None:
            new = new.model_copy(update={"controller": self.controller.located(folder)})
        return new.model_copy(update={"operator": self.operator.located(folder)})

    def own_parts(self) -> Iterator[tuple[str, OwnSource]]:
        """Yield (prefix of the paths of the file's parameters, code) for each user's file.

        Raises UserError.
        """
        yield from super().own_parts()
        for stage, source in () if self.controller is None else self.controller.parts():
            yield f"control.own.{stage}", source
        if (hands := self.operator.own) is not None:
            yield "operator.own.hands", hands

    @property
    def tools(self) -> tuple[str, ...]:
        """Tool names, one per arm."""
        defaults = DEFAULT_TOOLS[self.campaign.software]
        return self.campaign.tools or tuple(defaults[arm] for arm in self.campaign.arms)

    @property
    def operator_label(self) -> str:
        """Name of the motion in tables."""
        return self.operator.label

    @property
    def reacts(self) -> bool:
        """Whether the operator may react to the haptic cue."""
        return self.reaction is not None

    @property
    def watches_cables(self) -> bool:
        """Whether the mechanics have tensions that can be compared with a cable's strength."""
        return parameter_sets.tells_tension(self.campaign.parameter_set)

    @property
    def touches(self) -> bool:
        """Whether contact forces of the robot are outcomes."""
        return self.campaign.contact

    @property
    def robot_label(self) -> str:
        """Name of the control software that runs."""
        return self.campaign.software

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield (heading, text) of the file's settings for robot and operator."""
        yield from super().lines()
        operator = self.operator
        what = f"{operator.file}, recorded" if operator.file else f"{operator.label}, generated"
        hands = "" if operator.hands is None else f"; hands moved by {operator.hands}"
        yields = "" if self.hand is None else f"; the cue moves the hand, grip {self.hand.grip:g}"
        if self.campaign.contact:
            yield "contact", "of jaw tips with tissue and vessel, of instruments with each other"
        if self.controller is not None:
            files = (f"{stage}: {file}" for stage, file in self.controller.files())
            yield "controller", ", ".join(files)
        timing = f"; on average {self.cycles_a_packet:.3g} control cycles per packet"
        timing *= self.random_packets
        scale = f"; scale {operator.scale:g}"
        yield "operator", f"{what}{hands}{scale}{timing}{self._reaction()}{yields}"

    def _reaction(self) -> str:
        # Describes the operator's reaction to the cue in words.
        if self.reaction is None:
            return ""
        axes = [self.parameters, self.cross]
        axes += [axes for group in self.group for axes in (group.parameters, group.cross)]
        varies = "as reaction.action varies, or " * any("reaction.action" in a for a in axes)
        return f"; at the cue: {varies}{MEANINGS[self.reaction.action]}"

    def settings(self) -> dict[str, Any]:
        """Return the same as `lines` in the form of JSON."""
        return super().settings() | {
            "software": self.campaign.software,
            "operator": self.operator.model_dump(mode="json", exclude_none=True),
            "reaction": None if self.reaction is None else self.reaction.model_dump(mode="json"),
            "hand": None if self.hand is None else self.hand.model_dump(mode="json"),
        }

    @property
    def substeps(self) -> int:
        """Number of plant steps in a tick."""
        return self.campaign.substeps

    def generated_motions(self) -> tuple[str, ...]:
        """Names of the motions that the robot can generate."""
        return tuple(MOTIONS)

    def notices(self) -> Iterator[Complaint]:
        """See `CampaignConfig.notices`."""
        yield from super().notices()
        for name, section in (("operator.start", self.operator.start), ("limits", self.limits)):
            for key, angle in section.model_dump(exclude_none=True).items():
                largest = float(np.max(np.abs(angle)))
                if key.endswith("_deg") and 0 < largest <= math.pi:
                    yield (name, key), f"got {angle} degrees{suggest_unit(key, angle)}"
        axes = {path: axis for _, table in self.parameter_tables() for path, axis in table.items()}
        errors = [path for path in axes if ".kinematic_errors." in path]
        if self.campaign.kinematic_errors == "none" and all(p.endswith(".scale") for p in errors):
            yield from (
                (("parameters", path), "has no effect while campaign.kinematic_errors is 'none'")
                for path in errors
            )
        if self.campaign.kinematic_errors == "measured":
            yield from (
                (
                    ("parameters", path),
                    "the value 0 removes the errors of campaign.kinematic_errors = 'measured'",
                )
                for path in errors
                if path.endswith(".scale") and axes[path].values == (0,)
            )
        delay_ms = 250.0 if self.reaction is None else self.reaction.delay_ms
        if 0 < delay_ms < FASTEST_MS:
            unit = suggest_unit("delay_ms", delay_ms, FASTEST_MS)
            yield ("reaction", "delay_ms"), f"got {delay_ms:g}, faster than any person{unit}"
        if self.operator.motion == "still" and self.operator.seed:
            yield ("operator", "seed"), "motion 'still' is the same for every seed"
        if self.operator.place == "home" and self.operator.offset_mm is not None:
            yield (
                ("operator", "offset_mm"),
                "has no effect with place = 'home', which moves the tip to the home pose",
            )
        starts = dict(zip(JOINTS, HOME_JPOS, strict=True)) | self.operator.start.si()
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
        """See `CampaignConfig.notices_of_runs`."""
        paths = {path for _, table in self.parameter_tables() for path in table}
        groups = plan.rows["group"].cat.codes.to_numpy()

        def in_no_run(read: np.ndarray) -> np.ndarray:
            """Return the runs of the groups in which no run reads a number."""
            return ~np.isin(groups, groups[read])

        if self.campaign.software == "raven2":
            limits = any(path.startswith("control.overdrive.dac_max") for path in paths)
            key = "campaign.level" if self.campaign.level else "control.overdrive.dac_max"
            if self.campaign.level or limits:
                yield (
                    key,
                    in_no_run(plan.numbers("control.overdrive.policy") != 0),
                    "has no effect with policy 'no_regulation', which ignores these limits",
                )
        if self.detector and "detectors.armed_after" in paths:
            late = plan.numbers("detectors.armed_after") >= plan.ends
            yield "detectors.armed_after", late, "no detector becomes active before the run ends"
        if self.hand is not None:
            idle = plan.numbers("hand.newtons_per_unit") == 0
            yield "hand.newtons_per_unit", idle, "with 0 N per device unit the cue moves no hand"
        if self.reaction is not None:
            yield from self._reaction_notices(plan, paths, in_no_run)

    def _reaction_notices(
        self, plan, paths: set[str], in_no_run: Callable[[np.ndarray], np.ndarray]
    ) -> Iterator[tuple[str, np.ndarray, str]]:
        # Yields (key, runs, message) for values of [reaction] without effect.
        written = {
            "correct_speed" if name == "correct_mm_s" else name
            for name, field in Reaction.model_fields.items()
            if getattr(self.reaction, name) != field.default
        }
        numbers = {name: plan.numbers(f"reaction.{name}") for name in READ_BY}
        action = np.array(ACTIONS)[plan.numbers("reaction.action")]
        for name, actions in READ_BY.items():
            read = np.isin(action, actions)
            if name in written or f"reaction.{name}" in paths:
                unread = in_no_run(read)
                yield f"reaction.{name}", unread, "has no effect with this reaction.action"
            if name in IDLE:
                idle = read & (numbers[name] == IDLE[name])
                yield f"reaction.{name}", idle, f"with {IDLE[name]:g} the action has no effect"
        acts, cap = action != "none", self.haptics.cues()[0].cap
        force = numbers["felt_force"]
        yield (
            "reaction.felt_force",
            acts & (force > np.float32(cap)),
            f"{force.max():g} device units are never reached: the cue's cap is {cap:g}",
        )
        faults = (plan.faults["code"] > 0).any(axis=1) & (plan.acts < plan.ends)
        left = plan.ends - np.where(faults, plan.acts, 0)
        yield (
            "reaction.delay_ms",
            acts & (numbers["delay_ms"] >= left),
            "the delay is so long that the run ends before the operator acts",
        )

    @property
    def distances_mm(self) -> tuple[float, float]:
        """See `CampaignConfig.distances_mm`."""
        return HEALTHY_MM, REACH_MM

    def complaints(self) -> Iterator[Complaint]:
        """Yield (key, message) for each mistake in the robot's own sections."""
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
            # Older packets are computed again from the plan
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
        """Whether the length of packets is drawn in some run."""
        return self.campaign.packet_choice != packets.EVERY_CYCLE or any(
            any(axis.values) for axis in self._packet_axes
        )

    @property
    def _packet_axes(self) -> list[Axis]:
        name = "network.packets"
        return [table[name] for _, table in self.parameter_tables() if name in table]

    @property
    def packet_history(self) -> int:
        """Age in ms of the oldest packet that a network fault may send again; 0: none.

        Only for packets with drawn lengths; 0 without them.
        """
        if not self.random_packets:
            return 0
        return int(min(_oldest_packet_ms(self.group, self.longest_packet), self.campaign.ticks))

    @property
    def longest_packet(self) -> int:
        """Largest number of cycles that a packet may last, if lengths are drawn."""
        shares = self.campaign.packet_shares
        return max(map(len, (shares, *packets.SHARES) if self._packet_axes else (shares,)))

    @property
    def cycles_a_packet(self) -> float:
        """Mean number of cycles per packet; 1, the smallest, if the mean differs between runs."""
        return 1.0 if self._packet_axes else packets.mean_cycles(self.campaign.packet_shares)

    def unread(self, path: str) -> str:
        """Return why the parameter at `path` has no effect in this campaign, or ""."""
        if path == "control.overdrive.dac_max.grasp2":
            return "has no effect: the original's overdrive check ignores grasp2"
        from ravenjax.campaign.file import bounds  # imported late, because it needs the tick

        for quantity in bounds.allowed_values(self.robot, path):
            key, value = quantity.read_when or ("", "")
            if key and getattr(self.campaign, key) != value:
                return (
                    f"has an effect only with {key} = {value!r}: remove this parameter, or set"
                    f" {key} in [campaign]"
                )
        return ""

    def says_beyond(self, fault: Fault) -> bool:
        """Return whether the file states how the fault's values beyond 16 bits are stored.

        The fault's key `wraps` states it, or campaign.dac_words at site usb_out.
        """
        return super().says_beyond(fault) or (
            fault.site == "usb_out" and self.campaign.dac_words is not None
        )

    def deciding(self) -> dict[str, Any]:
        """Return the settings that affect all runs, on which run ids depend.

        Defaults are left out, except for tools and limits.
        """
        content = super().deciding()
        campaign = content["campaign"]
        if campaign.get("dac_words") == "wrap":  # same as without the key
            del campaign["dac_words"]
        files = {"file", "hands", "hands_sha256"}
        operator = self.operator.model_dump(mode="json", exclude=files, exclude_defaults=True)
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
        }
        hand = {} if self.hand is None else {"hand": self.hand.model_dump(mode="json")}
        stages = () if self.controller is None else self.controller.parts()
        digests = {stage: part.hash_source(source) for stage, source in stages}
        return content | sections | hand | ({"controller": digests} if digests else {})


# --- packets that network faults send again ---

LONGEST_HISTORY_MS = 8192
"""Length of the longest history of packets, which is stored if packet lengths are drawn.

Without draws, the tick in which an older packet was sent follows from its number. The history has
256 words and needs 9 000 operations per tick. The rest of a tick needs 11 400.
"""


def _oldest_packet_ms(groups: Iterable[Group], longest: int) -> float:
    """Return the age in ms of the oldest packet that faults may send again in any run.

    0 if no packet is sent again; infinite if the age has no bound. longest: largest number of
    cycles that a packet lasts.
    """
    runs = (
        faults
        for group in groups
        for faults in (group.fault, *(group.faults_of(run) for run in group.run))
    )
    return max((_age_ms(faults, longest) for faults in runs), default=0.0)


def _age_ms(faults: Iterable[Fault], longest: int) -> float:
    # Returns the age of the oldest packet that the faults of one run may send again, ms.
    network = [fault for fault in faults if fault.site == "network"]
    counts = [count for fault in network if (count := _packets(fault)) is not None]
    late = any("jitter" in _channels(fault) for fault in network)
    if not counts and not late:
        return 0.0
    # 2: increments count from the packet before the oldest, and the newest packet may be `longest`
    # cycles old.
    return (sum(counts) + 2) * longest + math.ceil(DELAY_MS[1] + JITTER_MS[1]) * late


def _packets(fault: Fault) -> float | None:
    """Return the longest delay by a network fault, in packets; None if the fault delays none."""
    if not _channels(fault) & {"lag", "delay"}:
        return None
    most = 0.0
    for name in fault.effect.listed:
        _, effect, value = NETWORK_EFFECTS.get(name, ("", name, None))
        if effect == "stuck":
            continue
        # Other effects add more than their value to a channel that other faults change.
        if effect not in ("overwrite", "offset", "latch_offset", "periodic", "random", "toggle"):
            return math.inf
        numbers = () if fault.value is None else fault.value.listed or fault.value.extent
        most = max(most, *(abs(number) for number in (numbers if value is None else (value,))), 0.0)
    return most


def _channels(fault: Fault) -> set[str]:
    # Returns the channels of a fault. An effect on packets names its channel itself.
    bound = {
        NETWORK_EFFECTS[name].channel for name in fault.effect.listed if name in NETWORK_EFFECTS
    }
    listed = () if fault.channel is None else fault.channel.listed
    return bound | ({"lag", "delay", "jitter"} if ALL in listed else set(listed))


def of_raven(config: CampaignConfig) -> RavenConfig:
    """Return the campaign of a Raven-II. Raises UserError if the campaign has another robot."""
    if not isinstance(config, RavenConfig):
        raise UserError(
            f"campaign.robot is {config.campaign.robot!r}, expected 'raven2', because this command"
            " works for a Raven-II only"
        )
    return config
