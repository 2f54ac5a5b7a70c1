"""Defines the pydantic model of a whole campaign file. Properties combine several sections.

A robot may add sections. `loading` reads a file, and `semantics` checks rules for several sections.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, PrivateAttr, field_validator

from ravenjax import robots
from ravenjax.campaign.file import sections
from ravenjax.campaign.file.axis import Axis
from ravenjax.campaign.file.group import Cross, Fault, Group, Parameters, Run, Section
from ravenjax.campaign.file.location import Complaint, Key, Where
from ravenjax.campaign.file.own_part import locate_part
from ravenjax.errors import is_table
from ravenjax.numbers.quantity import Quantity
from ravenjax.outcomes import events
from ravenjax.parts import part
from ravenjax.vocabulary.checks import Check, built_in_column
from ravenjax.vocabulary.detectors import DetectorUse
from ravenjax.vocabulary.parts import OwnSource
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.sites import PARAMETER, Channel


class CampaignConfig(Section):
    """A checked campaign with all keys and defaults."""

    campaign: sections.CampaignSection
    parameters: Parameters = Field(default_factory=dict)
    """path = value, list or distribution; from = a file of robots"""
    cross: Cross = Field(default_factory=dict)
    """path = list: every run is repeated with each value and equal random numbers, for paired
    comparisons"""
    haptics: sections.Haptics = sections.Haptics()
    detector: tuple[sections.Detector, ...] = ()
    """detectors, which observe the runs"""
    check: tuple[sections.OwnCheck, ...] = ()
    """your own checks in the control loop"""
    harm: tuple[sections.OwnHarm, ...] = ()
    """harms that you define"""
    outcomes: sections.Outcomes = sections.Outcomes()
    stop: sections.Stop | None = None
    """rule to stop early; without it all runs are computed"""
    group: tuple[Group, ...] = Field(min_length=1)
    """groups of runs"""
    _where: Where = PrivateAttr(Where(None, {}, []))
    _is_being_read: bool = PrivateAttr(False)
    _cached_names: tuple[Any, tuple[str, ...]] = PrivateAttr((None, ()))

    @field_validator("group", "detector", "check", "harm")
    @classmethod
    def _require_different_names(cls, tables: tuple[Any, ...]) -> tuple[Any, ...]:
        names = [table.name for table in tables]
        if repeated := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"got name {repeated[0]!r} twice, expected different names")
        return tables

    @property
    def where(self) -> Where:
        """The places of the campaign's keys in its file, for error messages."""
        return self._where

    @property
    def source(self) -> Path | None:
        """The file from which the campaign was read."""
        return self._where.source

    def keep_places(self, where: Where, is_being_read: bool) -> None:
        """Keep the places of the keys. is_being_read: ranges of parameters are not yet known."""
        self._where, self._is_being_read = where, is_being_read

    def with_files(self, folder: Path) -> "CampaignConfig":
        """Return a copy with absolute paths of Python files, which are relative to `folder`. Raise
        UserError for a file that cannot be used.
        """
        located: dict[str, tuple[Any, ...]] = {}
        for kind in ("detector", "check"):
            tables = getattr(self, kind)
            located[kind] = tuple(locate_part(table, folder, kind, table.name) for table in tables)
        return self.model_copy(update=located)

    @property
    def detectors(self) -> tuple[tuple[str, DetectorUse, tuple[float, ...]], ...]:
        """(name, detector, thresholds) of every detector, in order."""
        return tuple(
            (name, use, detector.threshold)
            for detector in self.detector
            for name, use in detector.uses()
        )

    @property
    def limit_counts(self) -> bool:
        """Whether unintended motion beyond outcomes.limit_mm counts as harm."""
        return all(harm.counts != "replaces" for harm in self.harm)

    @property
    def rules(self) -> events.Rules:
        """The campaign's settings on which the definitions of outcomes depend."""
        counted = [harm for harm in self.harm if harm.counts != "watch"]
        return events.Rules(
            cue=self.outcomes.cue,
            threshold_mm=self.haptics.cues()[self.outcomes.cue].threshold_m * 1e3,
            jump=f"jump_{self.outcomes.jump}",
            limit_mm=self.outcomes.limit_mm,
            built_in=built_in_column(self.own_checks, self.stops),
            harms=tuple(f"{harm.name}: {harm.when}" for harm in counted),
            limit_counts=self.limit_counts,
        )

    @property
    def robot(self) -> Robot:
        """The campaign's robot, with the user's checks added. Its site `parameter` has the
        parameters that faults name. While a file is being read, these have no units and no ranges,
        because the robot's tick, which has them, is slow to import.
        """
        # A copy of the campaign has the cached names of the original, but perhaps other groups.
        groups, names = self._cached_names
        if groups is not self.group:
            names = tuple(dict.fromkeys(name for *_, name in self.faulty_parameters()))
            self._cached_names = (self.group, names)
        channels = tuple(
            Channel(name, (), "float", "1")
            if self._is_being_read
            else self.parameter_channel(name)[0]
            for name in names
        )
        robot = robots.find_robot(self.campaign.robot)
        return robot.with_checks(self.own_checks).with_channels(PARAMETER, channels)

    def parameter_channel(self, name: str) -> tuple[Channel, str]:
        """Return the fault channel (type, unit, range) of the parameter with the path `name`, and
        the reason why no fault can change the parameter; "" if a fault can.
        """
        # This import needs the robot's tick, which is slow to import.
        from ravenjax.campaign.file import bounds

        model: Any = type(self)
        robot = robots.find_robot(self.campaign.robot)
        return bounds.parameter_channel(model, robot, self.campaign.arms, name)

    def faulty_parameters(self) -> Iterator[tuple[int, int, str]]:
        """Yield (index of the group, fault slot, path) of each parameter that a fault names."""
        for g, group in enumerate(self.group):
            if self.changeable and any(fault.site == PARAMETER for fault in group.fault):
                # `Run()` replaces no key of the group's faults.
                for run in group.run or (Run(),):
                    for slot, fault in enumerate(group.faults_of(run)):
                        if fault.site == PARAMETER and fault.channel:
                            yield from ((g, slot, name) for name in fault.channel.listed)

    @property
    def own_checks(self) -> tuple[Check, ...]:
        """The user's checks, in order."""
        return tuple(check.check for check in self.check)

    @property
    def stops(self) -> bool:
        """Whether a detector may stop the robot."""
        return any(detector.acts == "stop" for detector in self.detector)

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of the optional stages of the robot's tick for which the file asks: by a section
        with the name of the stage, or by a true key or property of [campaign] with this name.
        """
        names, keys = robots.find_robot(self.campaign.robot).stages, self.campaign
        return tuple(name for name in names if getattr(self, name, getattr(keys, name, None)))

    @property
    def slots(self) -> int:
        """Number of fault slots that a run needs."""
        return max(len(group.fault) for group in self.group)

    # --- what a robot may add ---

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield (name, value) of the settings of robot and operator, as texts for a table."""
        arms = self.campaign.arms
        text = " and ".join(arms)
        # The only arm of a robot from an MJCF file has the name "arm".
        if arms != ("arm",):
            text += " arms" if len(arms) > 1 else " arm"
        # A robot that has several versions of the control software is named by this version.
        label = getattr(self.campaign, "software", self.robot.title)
        yield "robot", f"{label}, {text}{', with noise' if self.campaign.noise else ''}"
        if self.campaign.observe_ms is not None:
            wait = f"{self.campaign.observe_ms:,} ms"
            yield "observed", f"until {wait} after the end of a run's last fault"

    def settings(self) -> dict[str, Any]:
        """The content of `lines` as values for JSON."""
        return {"robot": self.robot.name}

    operator_label: ClassVar[str] = "own"
    """Name of the operator's motion in tables."""
    random_packets: ClassVar[bool] = False
    """Whether each run draws the durations of the console's packets."""
    changeable: ClassVar[str] = ""
    """Regular expression of the beginnings of paths of the parameters that a fault can change."""
    without_effect: ClassVar[dict[str, str]] = {}
    """Paths of parameters that the robot never reads, and the reasons as texts."""
    cycles_a_packet: ClassVar[float] = 1.0
    """Mean number of control cycles per packet of the console."""

    def generated_motions(self) -> tuple[str, ...]:
        """Names of the motions that the robot can generate."""
        return ()

    def complaints(self) -> Iterator[Complaint]:
        """Yield (key, message) for each error that depends on the robot."""
        return iter(())

    def notices(self) -> Iterator[Complaint]:
        """Yield (key, message) of values without effect that only this class knows."""
        # The groups of the file, before the expansion of hazards.
        for number, group in enumerate(self._where.groups):
            names: list[Any] = group["hazards"] if isinstance(group.get("hazards"), list) else []
            for name in dict.fromkeys(names):
                if names.count(name) > 1:
                    yield ("group", number, "hazards"), f"{name} is listed twice, but is run once"

    def notices_of_runs(self, plan: Any) -> Iterator[tuple[str, np.ndarray, str]]:
        """Yield (key, bool [runs], message) of values without effect in some runs of a `Plan`."""
        return iter(())

    @property
    def distances_mm(self) -> tuple[float, float]:
        """Distance from the nominal model without a fault, and largest possible distance, mm."""
        return 0.0, math.inf

    def parameter_tables(self) -> Iterator[tuple[Key, dict[str, Axis]]]:
        """Yield (key, {path: axis}) of every table of parameters in the file."""
        yield ("parameters",), self.parameters
        yield ("cross",), self.cross
        for g, group in enumerate(self.group):
            yield ("group", g, "parameters"), group.parameters
            yield ("group", g, "cross"), group.cross
            for r, run in enumerate(group.run):
                yield ("group", g, "run", r, "parameters"), run.parameters

    @property
    def axes_by_path(self) -> dict[str, Axis]:
        """Path -> axis of each parameter in the tables of the file; the last table counts."""
        return {path: axis for _, table in self.parameter_tables() for path, axis in table.items()}

    def allows_beyond_16_bits(self, fault: Fault) -> bool:
        """Return whether a fault may have values beyond 16 bits."""
        return fault.wraps

    def deciding(self) -> dict[str, Any]:
        """Return the settings on which all runs depend, for the hash of run ids. Defaults are left
        out, so that a new key does not change the ids of existing campaigns.
        """
        ignored = {"name", "description", "seed", "limit", "chunk"}
        # Only detectors and checks that act change a run, a detector at its first threshold.
        stops = [
            [part.hash_source(use.part), use.consecutive, thresholds[0]]
            for _, use, thresholds in self.detectors
            if use.stops and use.part is not None
        ]
        checks = [
            # The name is part of the paths of parameters.
            [c.name, part.hash_source(c.source), c.at, c.acts, c.consecutive, c.threshold]
            for c in self.check
            if c.acts != "watch"
        ]
        added = {"stops": stops, "checks": checks, "harms": [harm.use for harm in self.harm]}
        campaign = self.campaign.model_dump(mode="json", exclude=ignored, exclude_defaults=True)
        # Run ids contain these two settings even if they have their defaults.
        outcomes = {"jump": "code", "cue": 0} | self.outcomes.model_dump(exclude_defaults=True)
        return {
            "campaign": campaign,
            "cues": self.haptics.cues(),
            "outcomes": outcomes,
            **{key: parts for key, parts in added.items() if parts},
        }

    @property
    def own_ranges(self) -> tuple[tuple[str, Quantity], ...]:
        """(path, allowed values) of each parameter of the user's files. Raises UserError."""
        checks = tuple((f"checks.threshold.{check.name}", part.THRESHOLD) for check in self.check)
        return checks + tuple(
            (f"{prefix}.{path}", limits)
            for prefix, source in self.own_parts()
            for path, limits in part.part_quantities(source)
        )

    def own_parts(self) -> Iterator[tuple[str, OwnSource]]:
        """Yield (prefix of its parameters' paths, code) of each user's file. Raises UserError."""
        for detector in self.detector:
            if (source := detector.source) is not None:
                yield f"detectors.own.{detector.name}", source
        for check in self.check:
            yield f"checks.own.{check.name}", check.source


def robot_of(raw: Any, folder: Path | None = None) -> Robot:
    """Return the robot that a campaign's tables name. Raise UserError for an unknown robot."""
    campaign = raw.get("campaign") if is_table(raw) else None
    name = campaign.get("robot", robots.DEFAULT) if is_table(campaign) else robots.DEFAULT
    return robots.find_robot(name if isinstance(name, str) else robots.DEFAULT, folder)


def config_class_of(robot: Robot) -> type[CampaignConfig]:
    """Return the pydantic model of a robot's campaigns."""
    return getattr(robot.part("campaign"), "Config", CampaignConfig)
