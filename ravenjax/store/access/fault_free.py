"""Finds fault-free runs in a campaign's result folder, which give rates of false cues.

The golden runs of a campaign are often a few seconds of one motion. They are too short for a rate
of false cues per hour. `ravenjax fault-free` therefore computes additional motions, each with its
own result folder inside the campaign's folder `fault_free`. Results of any fault-free campaign with
the same robot, cues and detectors may also be put there.
"""

import json
from pathlib import Path
from typing import NamedTuple

from ravenjax.errors import StoreError
from ravenjax.store import manifest as manifests
from ravenjax.store.manifest import Manifest, Nested
from ravenjax.vocabulary.packets import CHOICES, EVERY_CYCLE

FOLDER = "fault_free"
UNVARIED = ("still", "tip")
"""Generated motions that are the same for every seed."""
_NOT_OF_ROBOT = ("name", "description", "seed", "duration_s", "limit", "chunk")
"""Keys of [campaign] that do not describe the robot."""
SCALE = "scale"
"""The only key of [operator] that describes the robot; the other keys describe the motion."""
_WITHOUT_PART = ("group", "outcomes", "reaction", "stop", "cross")
"""Tables of a campaign file that do not affect fault-free motion up to the first cue."""
REACTION = "reaction."
"""Prefix of the paths of parameters that describe the operator's reaction to a cue."""


class MotionFolder(NamedTuple):
    """A result folder with fault-free runs."""

    path: Path
    manifest: Manifest


class Companions(NamedTuple):
    """The result folders with fault-free runs that belong to a campaign's result."""

    motions: tuple[MotionFolder, ...]  # same robot as the campaign, each with a different motion
    excluded: tuple[str, ...]  # result folders that cannot be used, as 'NAME: reason'


NO_COMPANIONS = Companions((), ())


def find_fault_free(folder: Path, campaign: Manifest) -> Companions:
    """Return the fault-free results in the subfolder FOLDER of a result folder, sorted by name.

    campaign: manifest of the result folder.
    """
    parent = Path(folder) / FOLDER
    paths = sorted(path for path in parent.iterdir() if path.is_dir()) if parent.is_dir() else []
    motions_so_far = {motion_of(campaign)}
    motions, excluded = [], []
    for path in paths:
        try:
            manifest = manifests.read_manifest(path)
        except StoreError as error:
            excluded.append(f"{path.name}: {str(error).removeprefix(f'{path}: ')}")
            continue
        known = motion_of(manifest) in motions_so_far
        if why := _difference(campaign, manifest) or "the same motion" * known:
            excluded.append(f"{path.name}: {why}")
        elif manifest.parts:
            motions_so_far.add(motion_of(manifest))
            motions.append(MotionFolder(path, manifest))
    return Companions(tuple(motions), tuple(excluded))


def motion_of(manifest: Manifest) -> str:
    """Return text that identifies the operator's motion in a campaign.

    Two campaigns have equal texts if their motions are the same, or if one motion continues the
    other. With noise or with packets of random durations, the text also includes the seed, because
    the same motion of the hands then causes another motion of the robot.
    """
    operator = _without(manifest.config.get("operator") or {}, (SCALE,))
    campaign = manifest.config.get("campaign") or {}
    usual = CHOICES[EVERY_CYCLE]
    random = campaign.get("noise") or campaign.get("packets", usual) != usual
    return json.dumps([operator, random and manifest.seed], sort_keys=True)


def _difference(campaign: Manifest, other: Manifest) -> str:
    # Returns why fault-free runs do not belong to the campaign, "" if they do.
    if campaign.code_hash != other.code_hash:
        return f"computed by another version of the code, {other.code_hash[:16]}"
    for name in ("cues", "detectors"):
        if getattr(campaign, name) != getattr(other, name):
            return f"has other {name}"
    changes = manifests.find_differences(robot_tables(other.config), robot_tables(campaign.config))
    return "; ".join(changes).replace(" requested", " in the campaign")


def robot_tables(config: Nested) -> Nested:
    """Return the tables of a campaign that decide how the robot follows fault-free motion."""
    parts = _without(config, _WITHOUT_PART)
    parts["campaign"] = _without(config.get("campaign", {}), _NOT_OF_ROBOT)
    parts["operator"] = {SCALE: config.get("operator", {}).get(SCALE)}
    parts["parameters"] = without_reaction(config.get("parameters", {}))
    return parts


def _without(table: Nested, names: tuple[str, ...]) -> Nested:
    return {name: value for name, value in table.items() if name not in names}


def without_reaction(parameters: Nested) -> Nested:
    """Return a table of parameters without those of the operator's reaction."""
    return {path: value for path, value in parameters.items() if not path.startswith(REACTION)}
