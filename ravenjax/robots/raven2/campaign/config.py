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
from ravenjax.errors import UserError
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
from ravenjax.robots.raven2.plant import parameter_sets
from ravenjax.robots.raven2.plant.kinematic_errors import MEASURED
from ravenjax.stages.channel import DELAY_MS, JITTER_MS
from ravenjax.vocabulary import packets
from ravenjax.vocabulary.effects import NETWORK_EFFECTS
from ravenjax.vocabulary.parts import OwnSource
from ravenjax.vocabulary.reactions import ACTIONS, MEANINGS

HEALTHY_MM = 0.1
"""A healthy robot that moves is further off its nominal model: 0.6 to 1.8 mm as generated."""
REACH_MM = 429.0
"""Longest distance of two places of the tip within the hard stops of joints 1 to 3."""
_REACTION = resources.read_tables(__file__, "reaction.toml")
READ_BY: dict[str, list[str]] = _REACTION["read_by"]
"""Actions that read each parameter of a reaction."""
IDLE: dict[str, float] = _REACTION["idle"]
"""Values with which an action has no effect."""


class RavenConfig(CampaignConfig):
    """A whole campaign file of a Raven-II."""

    campaign: RavenCampaign
    operator: Operator = Operator(motion="suture")
    limits: Limits = Limits()
    reaction: Reaction | None = None
    """an operator who reacts; without it nobody does"""
    controller: OwnStages | None = None
    """stages of the control software that are files of your own"""
    hand: Hand | None = None
    """a hand that the cue moves; without it the cue is a signal"""
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
        """Yield (prefix of its parameters' paths, code) for each user's file. Raises UserError."""
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
        hands = "" if operator.hands is None else f"; {operator.hands} has the hands"
        yields = "" if self.hand is None else f"; the cue moves the hand, grip {self.hand.grip:g}"
        if self.campaign.contact:
            yield "contact", "jaw tips with tissue and vessel, instruments with each other"
        if self.controller is not None:
            files = (f"{stage}: {file}" for stage, file in self.controller.files())
            yield "controller", ", ".join(files)
        timing = f"; a packet lasts {self.cycles_a_packet:.3g} cycles at the mean"
        timing *= self.random_packets
        scale = f"; scale {operator.scale:g}"
        yield "operator", f"{what}{hands}{scale}{timing}{self._reaction()}{yields}"

    def _reaction(self) -> str:
        if self.reaction is None:
            return ""
        axes = [self.parameters, self.cross]
        axes += [axes for group in self.group for axes in (group.parameters, group.cross)]
        varies = "reaction.action varies, elsewhere " * any("reaction.action" in a for a in axes)
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
                    yield (
                        (name, key),
                        f"got {angle} degrees; if radians are meant, write"
                        f" {np.round(np.degrees(angle), 2).tolist()}",
                    )
        axes = {path: axis for _, table in self.parameter_tables() for path, axis in table.items()}
        errors = [path for path in axes if ".kinematic_errors." in path]
        if self.campaign.kinematic_errors == "none" and all(p.endswith(".scale") for p in errors):
            yield from (
                (("parameters", path), "scales nothing while campaign.kinematic_errors is 'none'")
                for path in errors
            )
        if self.campaign.kinematic_errors == "measured":
            yield from (
                (("parameters", path), "0 removes the errors that campaign.kinematic_errors draws")
                for path in errors
                if path.endswith(".scale") and axes[path].values == (0,)
            )
        if self.operator.motion == "still" and self.operator.seed:
            yield ("operator", "seed"), "motion 'still' is the same for every seed"
        if self.operator.place == "home" and self.operator.offset_mm is not None:
            yield (
                ("operator", "offset_mm"),
                "place = 'home' moves the tip wherever the offset put it",
            )
        limits = self.limits.si()
        for joint, start in self.operator.start.si().items():
            low, high = limits.get(joint, (start, start))
            if not low <= start <= high:
                yield ("operator", "start"), f"{joint} begins beyond its limits in [limits]"
        sites = {
            fault.site
            for group in self.group
            for run in group.run or (Run(),)
            for fault in group.faults_of(run)
        }
        if self.campaign.dac_words is not None and "usb_out" not in sites:
            yield ("campaign", "dac_words"), "nothing reads it without a fault at site usb_out"

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
                    "decides nothing with policy 'no_regulation', which neither clips nor counts",
                )
        if self.detector and "detectors.armed_after" in paths:
            late = plan.numbers("detectors.armed_after") >= plan.ends
            yield "detectors.armed_after", late, "no detector looks before the run's end"
        if self.hand is not None:
            idle = plan.numbers("hand.newtons_per_unit") == 0
            yield "hand.newtons_per_unit", idle, "0 moves no hand"
        if self.reaction is not None:
            yield from self._reaction_notices(plan, paths, in_no_run)

    def _reaction_notices(
        self, plan: Any, paths: set[str], in_no_run: Callable[[np.ndarray], np.ndarray]
    ) -> Iterator[tuple[str, np.ndarray, str]]:
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
                yield f"reaction.{name}", unread, "nothing reads it with this reaction.action"
            if name in IDLE:
                idle = read & (numbers[name] == IDLE[name])
                yield f"reaction.{name}", idle, f"{IDLE[name]:g} leaves the action without effect"
        acts, cap = action != "none", self.haptics.cues()[0].cap
        force = numbers["felt_force"]
        yield (
            "reaction.felt_force",
            acts & (force > np.float32(cap)),
            f"{force.max():g} is never felt: the cue pulls with at most cap = {cap:g}",
        )
        faults = (plan.faults["code"] > 0).any(axis=1) & (plan.acts < plan.ends)
        left = plan.ends - np.where(faults, plan.acts, 0)
        yield (
            "reaction.delay_ms",
            acts & (numbers["delay_ms"] >= left),
            "an action after the first cue of a fault comes only after the run's end",
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
                f"is how the built-in operator reacts, but operator.hands is {hands}: let the file"
                " react (view.arms has the cue's force), and remove [reaction]; or remove"
                " operator.hands",
            )
        if self.operator.motion == "clutched" and self.campaign.console == "absolute":
            yield (
                ("operator", "motion"),
                "got 'clutched', expected console = 'increments': an absolute one has no clutch",
            )
        for key, table in self.parameter_tables():
            choice = table.get("network.packets")
            if choice and packets.OWN in choice.values and isinstance(self.campaign.packets, str):
                yield (
                    (*key, "network.packets"),
                    f"got {packets.OWN}, which means the shares in campaign.packets: write them"
                    " there",
                )
            if "network.cycles_per_packet" in table and self.random_packets:
                yield (
                    (*key, "network.cycles_per_packet"),
                    "nothing reads it where packets are drawn: remove it, or for n cycles a packet"
                    " write campaign.packets = [0, .., 1] with n numbers",
                )
        for g, group in enumerate(self.group):
            longest = self.longest_packet if self.random_packets else 1
            age = min(_oldest_packet_ms((group,), longest), self.campaign.ticks)
            # Older packets are computed again from the plan
            if hands is not None and age > 0:
                yield (
                    ("group", g),
                    "faults at site 'network' may send packets of before, which are made of the"
                    f" plan, but operator.hands is {hands}, which may have done otherwise: remove"
                    " operator.hands, or let the faults lose packets (effect 'drop', channels lost"
                    " and bursts)",
                )
            if self.random_packets and age > LONGEST_HISTORY_MS:
                yield (
                    ("group", g),
                    f"faults at site 'network' may send packets of {age:.0f} ms ago, expected at"
                    f" most {LONGEST_HISTORY_MS} where the lengths of packets are drawn:"
                    " give them smaller values, write a shorter campaign.duration_s, or"
                    ' campaign.packets = "every_cycle"',
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
        """Age in ms that a packet sent again may have, if lengths are drawn; 0: none is."""
        if not self.random_packets:
            return 0
        return int(min(_oldest_packet_ms(self.group, self.longest_packet), self.campaign.ticks))

    @property
    def longest_packet(self) -> int:
        """Return the largest number of cycles that a packet may last, if lengths are drawn."""
        shares = self.campaign.packet_shares
        return max(map(len, (shares, *packets.SHARES) if self._packet_axes else (shares,)))

    @property
    def cycles_a_packet(self) -> float:
        """Mean number of cycles per packet if it is the same in all runs, else 1, the least."""
        return 1.0 if self._packet_axes else packets.mean_cycles(self.campaign.packet_shares)

    def unread(self, path: str) -> str:
        """Return why the parameter at `path` has no effect in this campaign; "" if it has."""
        if path == "control.overdrive.dac_max.grasp2":
            return "nothing reads it: the original's check never looks at grasp2"
        from ravenjax.campaign.file import bounds  # imported late, because it needs the tick

        for quantity in bounds.allowed_values(self.robot, path):
            key, value = quantity.read_when or ("", "")
            if key and getattr(self.campaign, key) != value:
                return (
                    f"it is read only with {key} = {value!r}: remove it, or set {key} in [campaign]"
                )
        return ""

    def says_beyond(self, fault: Fault) -> bool:
        """Return whether values beyond 16 bits are meant: `wraps`, or `dac_words` at USB."""
        return super().says_beyond(fault) or (
            fault.site == "usb_out" and self.campaign.dac_words is not None
        )

    def deciding(self) -> dict[str, Any]:
        """Return what affects the outcome of every run alike, for run ids, without defaults."""
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
"""The longest history of packets that a tick keeps, if their lengths are drawn.

Without draws, the place of an older packet in the motion follows from its number. The history has
256 words, and needs 9 000 operations beside 11 400 of the rest of a tick.
"""


def _oldest_packet_ms(groups: Iterable[Group], longest: int) -> float:
    """Return the age of the oldest packet of all runs, ms; 0: none is sent again; may be infinite.

    longest: largest number of cycles that a packet lasts.
    """
    runs = (
        faults
        for group in groups
        for faults in (group.fault, *(group.faults_of(run) for run in group.run))
    )
    return max((_age_ms(faults, longest) for faults in runs), default=0.0)


def _age_ms(faults: Iterable[Fault], longest: int) -> float:
    network = [fault for fault in faults if fault.site == "network"]
    counts = [count for fault in network if (count := _packets(fault)) is not None]
    late = any("jitter" in _channels(fault) for fault in network)
    if not counts and not late:
        return 0.0
    # The packet before it is needed, too, because increments count from it. And the newest packet
    # may be `longest` old when it is needed.
    return (sum(counts) + 2) * longest + math.ceil(DELAY_MS[1] + JITTER_MS[1]) * late


def _packets(fault: Fault) -> float | None:
    """Return the longest delay by a fault of the network, in packets; None for another channel."""
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
    bound = {
        NETWORK_EFFECTS[name].channel for name in fault.effect.listed if name in NETWORK_EFFECTS
    }
    listed = () if fault.channel is None else fault.channel.listed
    return bound | ({"lag", "delay", "jitter"} if ALL in listed else set(listed))


def of_raven(config: CampaignConfig) -> RavenConfig:
    """Return the campaign as one of a Raven-II. Raises UserError if it is of another robot."""
    if not isinstance(config, RavenConfig):
        raise UserError(
            f"campaign.robot is {config.campaign.robot!r}: this needs a campaign of a Raven-II"
        )
    return config
