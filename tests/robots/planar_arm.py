"""A planar arm of two joints with motors: a module that declares the robot of an MJCF file."""

from pathlib import Path

from ravenjax.robots.mjcf import read_robot
from ravenjax.robots.mjcf.campaign import Config, Params, acted, prepare

__all__ = ["ROBOT", "Config", "Params", "acted", "prepare"]

ROBOT = read_robot(Path(__file__).with_suffix(".xml"), __name__, __name__)
