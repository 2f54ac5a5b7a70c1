"""Defines masses and inertias in models/raven2/raven2.xml: links 1-3 of the DSN 2016 authors'
model, the tool, and corrections that make both consistent.

The authors' model (raven2_sim: Li_DYN) ends at link 3, tool included. Here the tool has separate
joints, so link 3 is the authors' minus the tool. Mass and first moment of everything on the
insertion joint in the reference tool pose (roll 0, wrist 0, jaws 45 deg) equal the authors'. The
tensor of link 3 is that of a box of the carriage's size. The difference goes to link 2, which never
turns relative to link 3, so that only their sum matters.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

SIN_75 = math.sin(math.radians(75))
LINK_1_IZZ = (
    0.0045358983848622445 + 0.008 * SIN_75**2
)  # kg m^2 about its centre of mass, with the CAD tensor of link 2
# kg m^2, moved from link 1 Izz to link 2 as diag(1, 1, 0), which makes link 2's tensor physical.
LINK_2_SHIFT = 0.008
# m along x3, y3, z3; extent of the tool carriage in raven2_sim's left arm meshes.
CARRIAGE_SIZE = (0.09, 0.13, 0.11)


@dataclasses.dataclass(frozen=True)
class Inertial:
    """Mass (kg), centre of mass (m) and central tensor (kg m^2), all in the frame of the body that
    carries it.
    """

    mass: float
    com: np.ndarray
    tensor: np.ndarray

    def mirrored(self, signs: tuple[float, float, float]) -> Inertial:
        flip = np.diag(signs)
        return Inertial(self.mass, flip @ self.com, flip @ self.tensor @ flip)

    def about_origin(self) -> np.ndarray:
        return self.tensor + self.mass * _parallel(self.com)

    def placed(self, rotation: np.ndarray, position: np.ndarray) -> Inertial:
        """Return the same body seen from a frame in which its own frame has this rotation and
        position.
        """
        return Inertial(
            self.mass, rotation @ self.com + position, rotation @ self.tensor @ rotation.T
        )


def _parallel(com: np.ndarray) -> np.ndarray:
    return com @ com * np.eye(3) - np.outer(com, com)


def _symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> np.ndarray:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def authors_links() -> tuple[Inertial, Inertial, Inertial]:
    """Return links 1-3 in DH frames 1-3 (raven2_sim: Li_DYN/two_arm_dyn.cpp,
    Li_DYN/Matlab/global_vars.m).

    Link 2 has the CAD tensor. Of link 1's tensor only the remaining part of Izz (0.012) is known;
    Ixx and Iyy never have an effect.
    """
    one = Inertial(0.503, np.array([0.00717636, 0.104721, -0.132424]), np.eye(3) * LINK_1_IZZ)
    two = Inertial(
        0.753,
        np.array([-0.00410333, -0.1720100448, -0.2203124399]),
        _symmetric(81.579e-3, 44.329e-3, 37.686e-3, 0.773e-3, 0.762e-3, 37.973e-3),
    )
    three = Inertial(
        0.407,
        np.array([-0.0187051213, -0.000150527, -0.0005150726]),
        _symmetric(
            2.97150333977e-3,
            4.21000029e-4,
            2.91349666e-3,
            -1.33215489e-5,
            -2.73932557e-5,
            -5.53285783e-5,
        ),
    )
    return one, two, three


def box(mass: float, com: tuple[float, float, float], size: tuple[float, float, float]) -> Inertial:
    """Return a homogeneous box (full edge lengths, m)."""
    x, y, z = size
    tensor = mass / 12.0 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y])
    return Inertial(mass, np.array(com), tensor)


def tool() -> dict[str, Inertial]:
    """Return the instrument bodies in their own frames: roll (frame 4), wrist (frame 5), grasp1 and
    grasp2 (frame 6 at yaw 0).
    """
    across, along = (
        4.385435e-4,
        3.98541e-7,
    )  # raven2_sim: raven2_model.slx, tool shaft right, made axisymmetric
    return {
        "tool_roll": Inertial(
            0.031894, np.array([0.0, 0.0, 0.47 - 0.26614]), np.diag([across, across, along])
        ),
        "wrist": box(0.0020, (0.005, 0.0, 0.0), (0.016, 0.007, 0.007)),
        "grasp1": box(0.0008, (0.008, 0.0, 0.0), (0.020, 0.002, 0.004)),
        "grasp2": box(0.0008, (0.008, 0.0, 0.0), (0.020, 0.002, 0.004)),
    }


def spindle_armature(joint: str) -> float:
    """Return kg m^2 at the joint of the tool-adapter spindle that drives it, an aluminium disc of
    the tool capstan's radius.
    """
    radius, thickness, density = (
        10.905e-3,
        6e-3,
        2700.0,
    )  # m, m, kg/m^3; radius: raven2 include/raven/defines.h
    disc = 0.5 * math.pi * radius**4 * thickness * density
    ratio = {"tool_roll": 120 / 180, "wrist": 200 / 180, "grasp1": 100 / 90, "grasp2": 100 / 90}[
        joint
    ]
    return disc * ratio**2


def _rx(angle_deg: float) -> np.ndarray:
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])


def _rz(angle_deg: float) -> np.ndarray:
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def tool_in_link_3() -> list[Inertial]:
    """Return the tool's bodies in DH frame 3, in the reference pose."""
    bodies = tool()
    wrist_turn, wrist_at = _rx(90) @ _rz(-90), np.array([0, 0, -0.47])
    jaw_at = wrist_at + wrist_turn @ np.array([0.013, 0, 0])
    return [
        bodies["tool_roll"].placed(np.eye(3), wrist_at),
        bodies["wrist"].placed(wrist_turn, wrist_at),
        bodies["grasp1"].placed(wrist_turn @ _rx(90) @ _rz(-45), jaw_at),
        bodies["grasp2"].placed(wrist_turn @ _rx(90) @ _rz(45), jaw_at),
    ]


def gold() -> dict[str, Inertial]:
    """Return every moving body of the gold arm."""
    one, two, three = authors_links()
    hanging = tool_in_link_3()
    mass = three.mass - sum(part.mass for part in hanging)
    com = (three.mass * three.com - sum(part.mass * part.com for part in hanging)) / mass
    carriage = box(mass, tuple(com), CARRIAGE_SIZE)
    surplus = (
        carriage.about_origin()
        + sum(part.about_origin() for part in hanging)
        - three.about_origin()
    )
    turn = _rx(128) @ _rz(90)
    shift = LINK_2_SHIFT
    return {
        "shoulder": dataclasses.replace(one, tensor=one.tensor - np.eye(3) * shift * SIN_75**2),
        "elbow": dataclasses.replace(
            two, tensor=two.tensor - turn @ surplus @ turn.T + np.diag([shift, shift, 0.0])
        ),
        "insertion": carriage,
        **tool(),
    }


if __name__ == "__main__":
    for name, part in gold().items():
        print(name, part.mass, part.com, np.linalg.eigvalsh(part.tensor))
