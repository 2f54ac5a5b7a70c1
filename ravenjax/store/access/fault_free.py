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
_UNUSED_CAMPAIGN_KEYS = ("name", "description", "seed", "duration_s", "limit", "chunk")
"""Keys of [campaign] that do not describe the robot."""
SCALE = "scale"
"""The only key of [operator] that describes the robot; the other keys describe the motion."""
_UNUSED_TABLES = ("group", "outcomes", "reaction", "stop", "cross")
"""Tables of a campaign file that do not affect fault-free motion up to the first cue."""


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
    campaign: manifest of the result folder. A result is excluded if it belongs to another robot, or
    repeats the motion of the campaign or of an earlier result.
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
        is_known = motion_of(manifest) in motions_so_far
        why = _difference(campaign, manifest) or ("the same motion" if is_known else "")
        if why:
            excluded.append(f"{path.name}: {why}")
        elif manifest.parts:
            motions_so_far.add(motion_of(manifest))
            motions.append(MotionFolder(path, manifest))
    return Companions(tuple(motions), tuple(excluded))


def motion_of(manifest: Manifest) -> str:
    """Return text that identifies the operator's motion in a campaign. The text contains no
    duration, so a motion and a longer version of this motion have equal texts. With noise or with
    packets of random durations, the text also includes the seed, because the same motion of the
    hands then causes another motion of the robot.
    """
    # The teleoperation scale is left out, because it describes the robot: `robot_tables` has it.
    operator = _omit(manifest.config.get("operator") or {}, (SCALE,))
    campaign = manifest.config.get("campaign") or {}
    # With this choice, the console sends a packet in every control cycle.
    usual = CHOICES[EVERY_CYCLE]
    random = campaign.get("noise") or campaign.get("packets", usual) != usual
    return json.dumps([operator, random and manifest.seed], sort_keys=True)


def _difference(campaign: Manifest, other: Manifest) -> str:
    # Returns why the fault-free runs of `other` do not belong to a campaign, or "".
    if campaign.code_hash != other.code_hash:
        return f"computed by another version of the code, {other.code_hash[:16]}"
    for name in ("cues", "detectors"):
        if getattr(campaign, name) != getattr(other, name):
            return f"has other {name}"
    tables = robot_tables(other.config), robot_tables(campaign.config)
    return "; ".join(manifests.find_differences(*tables, "in the campaign"))


def robot_tables(config: Nested) -> Nested:
    """Return the tables of a campaign that decide how the robot follows fault-free motion."""
    tables = _omit(config, _UNUSED_TABLES)
    tables["campaign"] = _omit(config.get("campaign", {}), _UNUSED_CAMPAIGN_KEYS)
    tables["operator"] = {SCALE: config.get("operator", {}).get(SCALE)}
    tables["parameters"] = without_reaction(config.get("parameters", {}))
    return tables


def _omit(table: Nested, names: tuple[str, ...]) -> Nested:
    return {name: value for name, value in table.items() if name not in names}


def without_reaction(parameters: Nested) -> Nested:
    """Return a table of parameters without those of the operator's reaction."""
    return {path: value for path, value in parameters.items() if not path.startswith("reaction.")}
