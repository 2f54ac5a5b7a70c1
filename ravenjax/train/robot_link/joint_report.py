"""What a robot reports once a millisecond: one JSON object a line.

    {"tick": 7, "last_seq": 9, "runlevel": 3, "surgeon_mode": 1, "soft_estopped": 0, "brakes": 0,
     "fault_active": 0, "plc_runlevel": 3, "checks": {"joint_limit": [13308, 5]},
     "arms": {"gold": {"jpos": [..], "jpos_d": [..], "mpos": [..], "mvel": [..],
                       "position": [..], "dac": [..]}}}

`tick` counts ms since the robot's process began, `last_seq` is the number of the console's packet
that the robot took last (111 before the first one), and `checks` says of each check that has
tripped how often it has, and in which tick it first did. The other names and their units are those
of `protocol.frame`.
"""

from __future__ import annotations

import json
from typing import Annotated, Any

from pydantic import BaseModel, Field

from ravenjax.train.protocol.frame import Frame
from ravenjax.train.robot import ArmName

_FLAGS = ("surgeon_mode", "soft_estopped", "brakes", "fault_active")
_COMMON = ("runlevel", "plc_runlevel", *_FLAGS)
_OF_ARM = ("jpos", "jpos_d", "mpos", "mvel", "position", "dac")
_Seven = Annotated[list[float], Field(min_length=7, max_length=7)]
_Three = Annotated[list[float], Field(min_length=3, max_length=3)]
_Flag = Annotated[int, Field(ge=0, le=1)]
_RunLevel = Annotated[int, Field(ge=0, le=3)]


class ArmReport(BaseModel):
    """Of one arm."""

    jpos: _Seven
    jpos_d: _Seven
    mpos: _Seven
    mvel: _Seven
    position: _Three
    dac: _Seven


class JointReport(BaseModel):
    """Of one robot."""

    tick: int
    last_seq: int
    runlevel: _RunLevel
    surgeon_mode: int
    soft_estopped: _Flag = 0
    brakes: _Flag = 0
    fault_active: _Flag = 0
    plc_runlevel: _RunLevel = 0
    checks: dict[str, tuple[int, int]] = {}
    arms: dict[ArmName, ArmReport]

    def fill(self, frame: Frame) -> None:
        """Write what is reported into the channels of `frame`; arms that it lacks are left out.

        Where links and tip truly are is not reported: they count as where they were measured.
        """
        frame["tick"], frame["last_seq"] = self.tick, self.last_seq
        for name in _COMMON:
            frame[name] = getattr(self, name)
        for arm, report in self.arms.items():
            if arm in frame.layout.arms:
                for name in _OF_ARM:
                    frame[f"{arm}/{name}"] = getattr(report, name)
                frame[f"{arm}/link_jpos"], frame[f"{arm}/tip"] = report.jpos, report.position


def encode_report(
    frame: Frame, tick: int, last_seq: int, checks: dict[str, tuple[int, int]]
) -> bytes:
    """The line of a frame; the others as above."""
    report: dict[str, Any] = {"tick": tick, "last_seq": last_seq, "checks": checks}
    report |= {name: int(frame.number(name)) for name in _COMMON}
    report["arms"] = {
        arm: {name: frame[f"{arm}/{name}"].tolist() for name in _OF_ARM}
        for arm in frame.layout.arms
    }
    return encode_line(report)


def encode_line(content: dict[str, Any]) -> bytes:
    """An object as a line."""
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"
