"""Reads and writes manifest.json and parts.jsonl of a result folder.

manifest.json states what was computed, by which code and on which device. parts.jsonl has one line
for each finished Parquet file (*part*) of the result table. Lines are only appended, so that
recording a part takes the same time however many parts there are. A crash may leave an incomplete
line. This line and all later lines are ignored; their parts are found on disk and recorded again.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import json
import platform
from collections import Counter
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import pydantic
from pydantic import BaseModel, ConfigDict, Field

from ravenjax import resources, robots
from ravenjax.errors import StoreError, require_utf8
from ravenjax.outcomes.events import Rules
from ravenjax.outcomes.verdict import LIMIT_MM, PUBLISHED_CUE_MM
from ravenjax.store import schema
from ravenjax.store.files import KEPT, disk_errors, path_inside, read_json, write_text
from ravenjax.store.motion.summary import MotionSummary
from ravenjax.store.parts import Part, Row, require_version
from ravenjax.vocabulary.checks import built_in_column
from ravenjax.vocabulary.robot import Robot

FILE = "manifest.json"
PARTS_FILE = "parts.jsonl"
_LISTS = resources.read_tables(__file__, "manifest.toml")
_DECIDING, PACKAGES = _LISTS["deciding"], _LISTS["packages"]
Nested = dict[str, Any]
"""Nested tables, such as those of a campaign file."""


class CueRecord(BaseModel):
    """One haptic set. Its number is its position in `Manifest.cues`."""

    model_config = ConfigDict(frozen=True)

    threshold_mm: float  # mm, deviation from the nominal model above which the cue is on
    kp_per_mm: float  # device units per mm
    kd_s_per_mm: float = 0.0  # device units per (mm/s)
    cap: float | None = None  # device units, largest force


class DetectorRecord(NamedTuple):
    """One detector. Its number is its position in `Manifest.detectors`."""

    name: str
    kind: str  # see ravenjax.vocabulary.detectors
    fusion: str
    consecutive: int  # number of consecutive milliseconds above the threshold that raise an alarm
    thresholds: tuple[float, ...]  # in the unit of the score
    stops: bool = False  # an alarm at the first threshold presses the E-stop


class Manifest(BaseModel):
    """The record of one campaign. Times are UTC, ISO 8601."""

    model_config = ConfigDict(extra="ignore", ser_json_inf_nan="constants")

    schema_version: int = schema.VERSION
    campaign: str  # name of the campaign
    config: Nested  # the campaign with all defaults
    # sha256 of `config` and of every run id. A recording is included by its content, not its path.
    config_hash: str
    seed: int
    runs: Row  # rows of the fault table
    duration_ms: int
    shape: schema.Shape  # counts and names on which the columns of the table depend
    cues: tuple[CueRecord, ...] = ()
    detectors: tuple[DetectorRecord, ...] = ()
    operator: MotionSummary | None = None  # summary of a recorded motion of the operator
    verdict_cue: int = 0  # number of the haptic set that the column `verdict` uses
    # Column of the campaign's rule for jumps.
    verdict_jump: str = Field(default="jump_code", pattern="^jump_[a-z]+$")
    limit_mm: float = LIMIT_MM  # unintended motion above which a run has a hazard, mm
    engine: str
    device: str  # device that computed the runs, as text
    versions: dict[str, str] = Field(default_factory=lambda: package_versions())
    # XLA_FLAGS, and settings of JAX, for an engine whose code depends on these.
    settings: dict[str, str] = Field(default_factory=dict)
    # sha256 of the source files on which outcomes depend.
    code_hash: str = Field(default_factory=lambda: code_hash())
    started: str = Field(default_factory=lambda: utc_now())
    finished: str | None = None
    command: tuple[str, ...] = ()  # command line of the last start, if there was one
    notices: tuple[str, ...] = ()  # settings without effect, and notes of all starts
    # Shard of the campaign in this folder, such as 2/7; None: the whole campaign.
    shard: str | None = None
    # Row ranges (first, last inclusive) that this folder should contain; None: all rows.
    rows: tuple[tuple[Row, Row], ...] | None = None
    starts: int = 1  # number of starts of the command, including starts after interruptions
    # Of the last start: time of compilation (s), time of computation (s), runs per second.
    compile_s: float | None = None
    run_s: float | None = None
    runs_per_s: float | None = None
    parts: tuple[Part, ...] = ()  # finished parts, stored in parts.jsonl

    @property
    def robot(self) -> Robot:
        """The campaign's robot, with the user's checks added.

        Raises UserError if it cannot be found on this machine.
        """
        return robots.find_robot(self.shape.robot).with_checks(self.shape.own_checks)

    @property
    def rules(self) -> Rules:
        """The campaign's settings on which the definitions of outcomes depend."""
        # Texts about the cue state a threshold also if the campaign declares no haptic set.
        threshold = self.cues[self.verdict_cue].threshold_mm if self.cues else PUBLISHED_CUE_MM
        built_in = built_in_column(self.shape.own_checks, self.shape.stops)
        stopping = tuple((k, one.name) for k, one in enumerate(self.detectors) if one.stops)
        # A harm with "watch" is only reported. A harm with "replaces" counts instead of `limit_mm`.
        harms = [harm for harm in self.config.get("harm", ()) if harm["counts"] != "watch"]
        return Rules(
            cue=self.verdict_cue,
            threshold_mm=threshold,
            jump=self.verdict_jump,
            limit_mm=self.limit_mm,
            built_in=built_in,
            stopping=stopping,
            harms=tuple(f"{harm['name']}: {harm['when']}" for harm in harms),
            limit_counts=all(harm["counts"] != "replaces" for harm in harms),
        )

    @property
    def done(self) -> int:
        """Number of finished rows."""
        return sum(len(part.rows) for part in self.parts)

    @property
    def failures(self) -> dict[str, int]:
        """Number of finished runs without a valid outcome, by cause. Files without a count
        (`failed` is None) add nothing.
        """
        return dict(sum((Counter(part.failed) for part in self.parts), Counter()))

    @property
    def wanted(self) -> tuple[range, ...]:
        """The ranges of rows that this folder should contain, in order."""
        pairs = ((0, self.runs - 1),) if self.rows is None else self.rows
        return tuple(range(first, last + 1) for first, last in pairs)

    @property
    def due(self) -> int:
        """Number of rows that this folder should contain."""
        return sum(map(len, self.wanted))

    def _identity(self) -> Nested:
        # Returns what must be equal for a campaign to continue in the folder.
        names = "config_hash", "seed", "engine", "device", "versions", "settings", "shard"
        config = by_content(self.config, self.operator)
        inputs = {"code": self.code_hash[:16], "config": config}
        return self.model_dump(include={*names}) | inputs

    def differences(self, other: Manifest, word: str = "requested") -> list[str]:
        """Return the differences from `other` that affect outcomes, one line each.

        word: what a line calls the values of `other`.
        """
        return find_differences(self._identity(), other._identity(), word)


def find_differences(here: Nested, other: Nested, word: str = "requested") -> list[str]:
    """Return lines 'path: A here, B requested' for all differences, with at most 60 characters of
    each value. word: what a line calls the values of `other`.
    """
    all_changes = find_changes(here, other)
    if any(change.path.startswith("config.") for change in all_changes):
        # The hash follows from the config, so it adds nothing.
        all_changes = [change for change in all_changes if change.path != "config_hash"]
    return [
        f"{path}: {first or 'absent':.60} here, {second or 'absent':.60} {word}"
        for path, first, second in all_changes
    ]


class Change(NamedTuple):
    """A value in which two nested tables differ."""

    path: str  # dotted
    first: str | None  # as JSON; None: absent
    second: str | None


def find_changes(first: Nested, second: Nested) -> list[Change]:
    """Return every value in which two nested tables differ, by path."""
    one, other = _flat(first), _flat(second)
    names = sorted(one.keys() | other.keys())
    changes = [Change(name, one.get(name), other.get(name)) for name in names]
    return [change for change in changes if change.first != change.second]


def read_manifest(folder: Path) -> Manifest:
    """Return the manifest of a result folder. Raises StoreError if it is missing, damaged, or newer
    than this reader.
    """
    path = folder / FILE
    require_utf8(str(path.absolute()))
    missing = (
        f"{folder}: is not a result folder, because it has no {FILE}. Name the folder of the option"
        " --out of `ravenjax run`."
    )
    data = read_json(path, missing, f". {_RESTORE}")
    version = data.get("schema_version") if isinstance(data, dict) else None
    if isinstance(version, int):
        require_version(path, version)
    try:
        record = Manifest.model_validate(data).model_copy(update={"parts": read_parts(folder)})
        _Tables.model_validate(record.config)
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(item) for item in first["loc"]) or "top level"
        raise StoreError(f"{path}: {where}: {first['msg']}. {_RESTORE}") from error
    return record


class _Inner(BaseModel):
    """A group of a campaign, or a run or a fault of a group."""

    fault: list[_Inner] = []
    run: list[_Inner] = []
    parameters: Nested = {}
    cross: Nested = {}
    effect: str | list[Any] | Nested = ""


class _Named(_Inner):
    name: str


class _Check(_Named):
    threshold: float = 1.0
    consecutive: int = 1


class _Harm(_Named):
    when: str
    counts: str


class _Tables(_Inner):
    """Types of the keys of a stored campaign that commands read. Other keys may have any type."""

    campaign: Nested = {}
    operator: Nested = {}
    outcomes: dict[str, str | float] = {}
    reaction: Nested | None = None
    group: list[_Named] = []
    check: list[_Check] = []
    detector: list[_Named] = []
    harm: list[_Harm] = []


_RESTORE = (
    "The results are in other files: move this file away and start the same `ravenjax run` again,"
    " which keeps all complete files."
)


def read_parts(folder: Path) -> tuple[Part, ...]:
    """Return the files that `record_part` listed, up to the first incomplete line. A crash may have
    left this line incomplete. Raise StoreError if the list cannot be read.
    """
    path = folder / PARTS_FILE
    if not path.exists():
        return ()
    with disk_errors(f"{path}: cannot be read"):
        lines = path.read_bytes().splitlines(keepends=True)
    entries = []
    with contextlib.suppress(pydantic.ValidationError):
        for line in lines:
            if line.endswith(b"\n"):
                entries.append(Part.model_validate_json(line))
                # Raises StoreError for a file outside the folder.
                path_inside(folder, entries[-1].file)
    return tuple(entries)


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Replace the folder's manifest and its list of parts, each atomically."""
    lines = "".join(f"{part.model_dump_json()}\n" for part in manifest.parts)
    text = manifest.model_dump_json(indent=2, exclude={"parts"}) + "\n"
    write_text(folder / PARTS_FILE, lines)
    write_text(folder / FILE, text)


def record_part(folder: Path, part: Part) -> None:
    """Append a line about one file to the folder's list. This function is not thread-safe. It does
    not wait for the disk: a lost line can be made again. Raise StoreError if writing fails.
    """
    path = folder / PARTS_FILE
    with disk_errors(f"{path}: cannot be written", KEPT), open(path, "ab") as file:
        file.write(f"{part.model_dump_json()}\n".encode())


def join_ranges(*lists: tuple[tuple[int, int], ...] | None) -> tuple[tuple[int, int], ...] | None:
    """Return the union of lists of row ranges (first, last inclusive), in order and disjoint. A
    list that is None contains all rows, and so does the union then.
    """
    if any(ranges is None for ranges in lists):
        return None
    union: list[tuple[int, int]] = []
    for first, last in sorted(pair for ranges in lists if ranges is not None for pair in ranges):
        if union and first <= union[-1][1] + 1:
            begin, end = union[-1]
            union[-1] = begin, max(last, end)
        else:
            union.append((first, last))
    return tuple(union)


def utc_now() -> str:
    """Return the current time, UTC, ISO 8601 to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def campaign_hash(config: Nested, operator: MotionSummary | None, runs: str) -> str:
    """Return `Manifest.config_hash` of a campaign, its operator and the digest of its run ids."""
    return config_hash({"config": by_content(config, operator), "runs": runs})


def by_content(config: Nested, operator: MotionSummary | None) -> Nested:
    """Return a campaign without paths, so that copies of its files give the same campaign. The hash
    of a recording replaces its path. The name of a robot's file replaces its path, because its
    content is in the hash of the code.
    """
    if (campaign := config.get("campaign")) and "robot" in campaign:
        config = config | {"campaign": campaign | {"robot": Path(campaign["robot"]).name}}
    if operator is None:
        return config
    return config | {"operator": config["operator"] | {"file": f"sha256:{operator.sha256}"}}


def config_hash(config: Nested) -> str:
    """Return the sha256 of a resolved config. It does not depend on the order of keys."""
    text = json.dumps(config, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def package_versions() -> dict[str, str]:
    """Return the versions of Python and of packages that affect results; "absent" if missing."""

    def version(name: str) -> str:
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            return "absent"

    return {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}


@functools.cache
def code_hash(robot: Robot = robots.USUAL) -> str:
    """Return the sha256 over the names and contents of the files on which outcomes depend. These
    are the files in the folders `_DECIDING` of this package, the files that the robot declares
    (such as models), and the robot's package, or, if the robot is a single module, this module and
    the modules of its folder that it imports. The files are read at the first call.
    """
    package = Path(__file__).resolve().parents[1]
    contents = {
        path.relative_to(package).as_posix(): path
        for folder in _DECIDING
        for path in package.glob(f"{folder}/*")
        if path.suffix != ".pyc" and path.is_file()
    }
    spec = importlib.util.find_spec(robot.package)
    module = Path(spec.origin) if spec is not None and spec.origin is not None else Path()
    if spec is not None and spec.submodule_search_locations:
        contents |= {
            f"robot {path.relative_to(module.parent).as_posix()}": path
            for path in module.parent.rglob("*.py")
        }
    else:
        contents |= {f"robot {path.name}": path for path in robots.imported_beside(module)}
    # Two declared files in different folders may have the same name, so each has a number.
    for number, name in enumerate(robot.files):
        beside = module.parent / name
        path = beside if beside.is_file() else resources.find_model(name)
        contents[f"robot {number} {path.name}"] = path
    digest = hashlib.sha256()
    for name, path in sorted(contents.items()):
        digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _flat(tree, prefix: str = "") -> dict[str, str]:
    """Return nested values as JSON by path, such as group[0].bit. A list of values is one value."""
    if isinstance(tree, dict):
        branches = {f"{prefix}.{key}" if prefix else str(key): tree[key] for key in tree}
    elif isinstance(tree, list | tuple) and any(isinstance(entry, dict) for entry in tree):
        branches = {f"{prefix}[{number}]": entry for number, entry in enumerate(tree)}
    else:
        return {prefix: json.dumps(tree, sort_keys=True, default=str)}
    leaves = {}
    for name, branch in branches.items():
        leaves |= _flat(branch, name)
    return leaves
