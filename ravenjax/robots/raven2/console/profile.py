"""Console profiles: files with meaning, unit and bounds of each field of a console's packets."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

LENGTHS_UM = {"um": 1.0, "mm": 1e3, "m": 1e6}
ANGLES_RAD = {"mrad": 1e-3, "rad": 1.0, "deg": math.pi / 180.0}

Length = Literal["um", "mm", "m"]
Angle = Literal["mrad", "rad", "deg"]
Scale = Annotated[float, Field(gt=0.0, le=1000.0)]


class ProfileTable(BaseModel):
    """A table of a profile file. Unknown keys are refused, and text is not converted to numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


class SentPosition(ProfileTable):
    """[position]: the fields delx, dely, delz, the increment of the tip along the ITP axes."""

    unit: Length = "um"  # Unit of the number 1 in a field
    scale: Scale = 1.0  # Factor for increments

    @property
    def um(self) -> float:
        """Motion of the tip for the number 1 in a field, um."""
        return LENGTHS_UM[self.unit] * self.scale


class SentOrientation(ProfileTable):
    """[orientation]: the fields Qx, Qy, Qz, Qw, which contain the rotation of the hand."""

    # increments: the rotation since the last packet, as a unit quaternion; vector: this rotation as
    # a rotation vector in Qx, Qy, Qz, with Qw = 1; quaternion: the hand's orientation
    form: Literal["increments", "vector", "quaternion"] = "increments"
    unit: Angle = "rad"  # Unit of a vector's length; quaternions have none
    scale: Scale = 1.0  # Factor for a vector

    @model_validator(mode="after")
    def _quaternions_have_no_unit(self) -> SentOrientation:
        if self.form != "vector" and (self.unit != "rad" or self.scale != 1.0):
            raise ValueError(
                f"unit and scale are for form = 'vector' only, not for {self.form!r}: remove them"
            )
        return self

    @property
    def rad(self) -> float:
        """Angle of a rotation vector of length 1, rad."""
        return ANGLES_RAD[self.unit] * self.scale


class SentJaw(ProfileTable):
    """[jaw]: the field grasp, the motion or position of the jaw."""

    # increments: change since the last packet; positions: position of the console's jaw
    form: Literal["increments", "positions"] = "increments"
    unit: Angle = "mrad"  # Unit of the number 1 in the field
    scale: Scale = 1.0  # Factor for values
    closes: Literal["rising", "falling"] = "rising"  # Direction of values while the jaw closes
    lowest_mrad: float = -math.inf  # Lower bound of positions, scaled; smaller values are refused
    highest_mrad: float = math.inf  # Upper bound of positions, scaled; larger values are refused

    @model_validator(mode="after")
    def _positions_have_a_range(self) -> SentJaw:
        ends = self.lowest_mrad, self.highest_mrad
        if self.form == "positions" and not -math.inf < ends[0] < ends[1] < math.inf:
            raise ValueError(
                "form = 'positions' needs the range of the console's jaw, with lowest_mrad below"
                " highest_mrad: write for example lowest_mrad = -200.0 and highest_mrad = 1800.0"
            )
        if self.form == "increments" and ends != (-math.inf, math.inf):
            raise ValueError(
                "lowest_mrad and highest_mrad are for form = 'positions' only: remove them"
            )
        return self

    @property
    def mrad(self) -> float:
        """Angle by which the number 1 closes the jaw, mrad; negative if rising numbers open it."""
        return ANGLES_RAD[self.unit] * 1e3 * self.scale * (1.0 if self.closes == "rising" else -1.0)


class SentStream(ProfileTable):
    """[stream]: how packets follow one another."""

    # Packets that the console sends per second
    rate_hz: float = Field(default=1000.0, gt=0.0, le=20_000.0)
    # Largest number of packets that are added up in a millisecond; further packets wait
    per_tick: int = Field(default=4, ge=1, le=32)
    checksum: bool = True  # Whether a packet with a wrong checksum is refused
    # Content of the field buttonstate: anything (free), or always the same as in grasp (jaw)
    buttonstate: Literal["free", "jaw"] = "free"


class LargestSteps(ProfileTable):
    """[largest]: largest motions that one packet may command. The robot has no such bounds."""

    step_um: float = Field(default=1000.0, gt=0.0, le=1000.0)  # Displacement, um
    turn_rad: float = Field(default=0.1, gt=0.0, le=0.1)  # Rotation, rad
    jaw_mrad: float = Field(default=200.0, gt=0.0, le=200.0)  # Motion of the jaw, mrad


class ConsoleProfile(ProfileTable):
    """A whole profile file."""

    name: str = Field(pattern=r"^[a-z][a-z0-9_]*$", description="name for the option --console")
    title: str = Field(min_length=1, description="the console in words")
    source: str = Field(min_length=1, description="source of the meaning of the packets")
    position: SentPosition = SentPosition()
    orientation: SentOrientation = SentOrientation()
    jaw: SentJaw = SentJaw()
    stream: SentStream = SentStream()
    largest: LargestSteps = LargestSteps()
