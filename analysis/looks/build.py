"""Writes models/raven2/raven2.xml and its meshes: `python analysis/looks/build.py [FOLDER]`.

Bodies have the DH frames of the control software (raven2: src/raven/r2_kinematics.cpp), so that
MuJoCo's qpos equals its jpos. Gold is written out, and green is its mirror image. Numbers and
sources: models/raven2/PROVENANCE.md.
"""

import dataclasses
import math
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import inertias
import numpy as np
import scene
import shapes

MODEL = Path(__file__).resolve().parents[2] / "models" / "raven2"

# Signs of the axes of a link frame under which green is the mirror image of gold (tool at zero).
FLIPPED = {
    "frame0": (1, -1, 1),
    "shoulder": (-1, -1, -1),
    "elbow": (1, 1, -1),
    "insertion": (1, -1, 1),
    "tool_roll": (1, -1, 1),
    "wrist": (1, 1, -1),
    # Each jaw is its own mirror image, so the jaws swap instead.
    "grasp1": (1, 1, 1),
    "grasp2": (1, 1, 1),
}
LIMITS_DEG = {  # raven2: defines.h, tools.cpp (r_grasper); insertion in m
    "shoulder": (0, 90),
    "elbow": (45, 135),
    "insertion": (0.23, 0.56),
    "tool_roll": (-182, 182),
    "wrist": (-70, 70),
    "grasp1": (-105, 105),
    "grasp2": (-105, 105),
}
HOME = (math.radians(30), math.radians(90), 0.40, 0.0, 0.0, math.radians(45), math.radians(45))


@dataclasses.dataclass(frozen=True)
class Step:
    """One joint's body in its parent: Rx(twist) Rz(turn), then `position` in the parent;
    deg and m.
    """

    joint: str
    parent: str
    twist: float
    turn: float
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis: tuple[int, int, int] = (0, 0, 1)


def steps(arm: str) -> list[Step]:
    gold = arm == "gold"
    return [
        Step("shoulder", "frame0", 0 if gold else 180, 205 if gold else 25),
        Step("elbow", "shoulder", 75, 180 if gold else 0),
        Step("insertion", "elbow", 128 if gold else 52, 90 if gold else -90),
        Step("tool_roll", "insertion", 0, 0, (0, 0, -0.47)),
        Step("wrist", "tool_roll", 90, -90),
        Step("grasp1", "wrist", 90, 0, (0.013, 0, 0), (0, 0, -1)),
        Step("grasp2", "wrist", 90, 0, (0.013, 0, 0)),
    ]


def numbers(values) -> str:
    return " ".join(repr(float(x) + 0.0) for x in values)


def quaternion(twist: float, turn: float) -> tuple[float, ...]:
    """Return the quaternion of Rx(twist) Rz(turn), deg."""
    (a, b), (c, d) = (
        (math.cos(math.radians(x) / 2), math.sin(math.radians(x) / 2)) for x in (twist, turn)
    )
    return a * c, b * c, -b * d, a * d


def add_arm(world: ET.Element, arm: str) -> None:
    sign = 1 if arm == "gold" else -1
    bodies = {"frame0": ET.SubElement(world, "body", name=f"{arm}_frame0")}
    bodies["frame0"].set("pos", numbers((-sign * scene.RCM[0], *scene.RCM[1:])))
    # x0 up, z0 along the shoulder axis towards the other arm
    bodies["frame0"].set("xyaxes", "0 0 1 0 -1 0" if arm == "gold" else "0 0 1 0 1 0")
    parts = inertias.gold()
    for step in steps(arm):
        name = step.joint
        body = ET.SubElement(bodies[step.parent], "body", name=f"{arm}_{name}")
        bodies[name] = body
        body.set("pos", numbers(step.position))
        body.set("quat", numbers(quaternion(step.twist, step.turn)))
        part = parts[name] if arm == "gold" else parts[name].mirrored(FLIPPED[name])
        tensor = part.tensor
        full = (tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2])
        ET.SubElement(
            body, "inertial", mass=repr(part.mass), pos=numbers(part.com), fullinertia=numbers(full)
        )
        low, high = LIMITS_DEG[name]
        slide = name == "insertion"
        joint = ET.SubElement(
            body, "joint", name=f"{arm}_{name}", type="slide" if slide else "hinge"
        )
        joint.set("axis", " ".join(str(x) for x in step.axis))
        joint.set(
            "range", numbers((low, high) if slide else (math.radians(low), math.radians(high)))
        )
        if name in ("tool_roll", "wrist", "grasp1", "grasp2"):
            joint.set("armature", repr(inertias.spindle_armature(name)))
        if name == "wrist":
            tip = ET.SubElement(body, "site", name=f"{arm}_tip", size="0.001", group="4")
            tip.set("pos", "0.013 0 0")
            tip.set("quat", numbers(quaternion(90, 0)))
    for name, body in bodies.items():
        shapes.add(body, name, np.array((1, 1, 1) if arm == "gold" else FLIPPED[name]))


def build() -> ET.Element:
    root = ET.Element("mujoco", model="raven2")
    ET.SubElement(root, "compiler", angle="radian", meshdir="meshes", autolimits="true")
    ET.SubElement(root, "option", timestep="0.001", gravity="0 0 -9.81")
    scene.add_settings(root)
    assets = ET.SubElement(root, "asset")
    scene.add_assets(assets)
    shapes.add_assets(assets, FLIPPED)
    world = ET.SubElement(root, "worldbody")
    scene.add_world(world)
    for arm in ("gold", "green"):
        add_arm(world, arm)
    key = ET.SubElement(ET.SubElement(root, "keyframe"), "key", name="home")
    key.set("qpos", numbers(HOME + HOME))
    return root


def text() -> str:
    root = build()
    root.insert(
        0,
        ET.Comment(" Written by analysis/looks/build.py; sources of the numbers in PROVENANCE.md "),
    )
    ET.indent(root, space="  ")
    return ET.tostring(root, encoding="unicode") + "\n"


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else MODEL
    shapes.write_meshes(folder / "meshes")
    scene.write_meshes(folder / "meshes")
    (folder / "raven2.xml").write_text(text(), encoding="utf-8")
    print(f"wrote {folder / 'raven2.xml'}")
