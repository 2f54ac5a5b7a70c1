"""The result table: one row per run, input columns beside outcome columns.

Each column has a name, the smallest type that holds it, a unit and a meaning; results/README.md is
the same in prose. Column names that repeat (fault slots, cues, checks, arms, varied parameters)
follow from a `Shape`.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import pyarrow as pa

from ravenjax import robots
from ravenjax.errors import StoreError
from ravenjax.store import words
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.checks import Check
from ravenjax.vocabulary.robot import Robot

if TYPE_CHECKING:
    import pandas as pd

VERSION = 1
"""Raised whenever a column changes its name, type, unit or meaning; a new column alone does not
raise it.
"""

Columns: TypeAlias = "Mapping[str, Any] | pd.DataFrame"
"""Columns by name, arrays [rows]."""


@dataclass(frozen=True)
class Column:
    """One column: `dtype` is an Arrow type name, or "category" for dictionary-encoded strings."""

    name: str
    dtype: str
    unit: str
    meaning: str


_USUAL = robots.find(robots.DEFAULT)


@dataclass(frozen=True)
class Shape:
    """What decides which repeated columns a campaign's table has."""

    robot: str = robots.DEFAULT  # as `robots.find` takes it
    arms: tuple[str, ...] = _USUAL.arms[:1]
    joints: tuple[str, ...] = _USUAL.joints
    slots: int = 1  # fault slots per run
    cues: int = 1  # haptic threshold and gain sets evaluated side by side
    checks: tuple[str, ...] = tuple(_USUAL.checks)
    parameters: tuple[str, ...] = ()  # paths of the varied parameters
    reacts: bool = False  # the operator may react to the cue
    hand_yields: bool = False  # the cue's force moves the operator's hand
    cables: bool = False  # what the robot's cables carry is an outcome
    contact: bool = False  # how hard its instruments press is an outcome
    detectors: tuple[int, ...] = ()  # how many thresholds each detector has
    observes: bool = False  # runs end some time after their last fault has
    own_checks: tuple[Check, ...] = ()  # which of the checks are of one's own
    stops: bool = False  # a detector may stop the robot


def columns(shape: Shape) -> tuple[Column, ...]:
    """Every column of a campaign's table, in order."""
    robot = robots.find(shape.robot).with_checks(shape.own_checks)
    return (
        *_identity(),
        *(column for slot in range(shape.slots) for column in _fault(slot)),
        *(
            Column(f"param:{path}", "float64", "as the parameter", "varied parameter")
            for path in shape.parameters
        ),
        *(column for slot in range(shape.slots) for column in _applied(slot)),
        *_observed(shape),
        *_course(robot),
        *_built_in(shape),
        *(column for check in shape.checks for column in _check(robot.check(check))),
        *(column for cue in range(shape.cues) for column in _cue(cue)),
        *_reaction(shape),
        *(
            column
            for d, thresholds in enumerate(shape.detectors)
            for column in _detector(d, thresholds)
        ),
        *_motion(),
        *_cables(shape),
        *_contact(shape),
        *_golden(shape),
        *(
            Column(
                f"peak_dac_{arm}_{joint}",
                "int32",
                "DAC counts",
                "largest |current_cmd| sent to the motor",
            )
            for arm in shape.arms
            for joint in shape.joints
        ),
        Column(
            "failed",
            "category",
            "",
            'why the outcome is not valid, as "model tip not finite"; "": it is valid',
        ),
        Column(
            "failed_first_ms", "int32", "ms", "when that number was first not finite, -1 if never"
        ),
        Column(
            "hazard",
            "category",
            "",
            '"unintended motion", "loss of motion", "false report" or "none", the gravest',
        ),
        Column("verdict", "category", "", '"<response>/<hazard>/<cue|no cue>", or "" where failed'),
    )


def _identity() -> Iterator[Column]:
    yield Column(
        "run_id", "string", "", "16 hex digits, hash of everything that decides the run's outcome"
    )
    yield Column("index", "int32", "", "row of the campaign's fault table, from 0")
    yield Column(
        "pair",
        "int32",
        "",
        "index of the first run that differs in crossed parameters alone, or its own",
    )
    yield Column("group", "category", "", "name of the campaign's design block")
    yield Column("seed", "int64", "", "seed of the run's random numbers")
    yield Column("operator", "category", "", "operator motion")


def _fault(slot: int) -> Iterator[Column]:
    name = f"fault{slot}_"
    yield Column(f"{name}site", "category", "", 'fault site, "" where the slot is empty')
    yield Column(f"{name}arm", "category", "", 'arm, "" where the site belongs to no arm')
    yield Column(f"{name}channel", "category", "", "joint, axis or field of the site")
    yield Column(f"{name}effect", "category", "", "what the fault does to the value")
    yield Column(
        f"{name}value", "float64", "as the site", "magnitude, NaN where the effect has none"
    )
    yield Column(f"{name}trigger", "category", "", "what the onset counts from")
    yield Column(f"{name}start_ms", "int32", "ms", "onset, counted as the trigger says")
    yield Column(f"{name}duration_ms", "int32", "ms", "length of the fault window")
    yield Column(f"{name}every_ms", "int32", "ms", "period of the window, 0 if it comes once")
    yield Column(f"{name}period_ms", "int32", "ms", "period of effect periodic, 0 for others")


def _applied(slot: int) -> Iterator[Column]:
    name = f"applied{slot}_"
    yield Column(
        f"{name}first_ms",
        "int32",
        "ms",
        "when this slot's fault first changed its channel, -1 if never",
    )
    yield Column(f"{name}last_ms", "int32", "ms", "when it last did, -1 if never")
    yield Column(f"{name}ticks", "int32", "ticks", "how many ticks it did")


OBSERVED = "observed_ms"
"""Column of when a run ended."""


def _observed(shape: Shape) -> Iterator[Column]:
    if shape.observes:
        meaning = (
            "when the run ended, observe_ms after its last fault; outcomes, the golden run's too,"
            " are until then"
        )
        yield Column(OBSERVED, "int32", "ms", meaning)


def _course(robot: Robot) -> Iterator[Column]:
    yield Column("activated", "bool", "", "the fault changed at least one bit of a signal")
    yield Column("first_active_ms", "int32", "ms", "when it first did, -1 if never")
    yield Column("active_ticks", "int32", "ticks", "how many ticks it did")
    levels = ", ".join(f"{number} {name}" for number, name in enumerate(robot.run_levels))
    yield Column(
        "end_runlevel", "int8", "", f"run level at the end: {levels}; -1: a number that is none"
    )
    yield Column("pedal_down_ms", "int32", "ms", "time in pedal-down without software E-stop")
    yield Column("diverged", "bool", "", "the robot's course differs from that of the golden run")
    yield Column(
        "response",
        "category",
        "",
        'what checks did beyond the golden run: "stopped", "flagged", "limited" (nobody was told)'
        ' or "silent"',
    )
    yield Column(
        "response_cause", "category", "", 'check of that kind that did so first, "" if none'
    )
    yield Column("response_ms", "int32", "ms", "when it did, -1 if none")
    yield Column(
        "told_ms",
        "int32",
        "ms",
        "when a check first told a person or stopped the robot, -1 if never",
    )


def _built_in(shape: Shape) -> Iterator[Column]:
    if checks.apart(shape.own_checks, shape.stops):
        yield Column(
            checks.BUILT_IN,
            "category",
            "",
            "response of the built-in checks alone, until a check or detector of one's own stopped"
            " or limited",
        )
        yield Column(
            "built_in_told_ms",
            "int32",
            "ms",
            "when one of those first told a person or stopped the robot, -1 if never",
        )


def _check(check: Check) -> Iterator[Column]:
    name, unit, what, *_ = check
    yield Column(f"check_{name}_first_ms", "int32", "ms", f"{what}: first trip, -1 if none")
    yield Column(f"check_{name}_count", "int32", "ticks", f"{what}: ticks tripped")
    yield Column(
        f"check_{name}_margin",
        "float32",
        unit,
        f"{what}: least distance to the limit, negative beyond, inf if never measured",
    )


def _cue(cue: int) -> Iterator[Column]:
    yield Column(
        f"cue{cue}_first_ms", "int32", "ms", "haptic cue: first non-zero force, -1 if none"
    )
    yield Column(f"cue{cue}_peak_force", "float32", "device units", "haptic cue: largest force")
    yield Column(f"cue{cue}_ms", "int32", "ms", "haptic cue: total time with force")
    yield Column(f"cue{cue}_count", "int32", "", "haptic cue: separate pulses")


def _reaction(shape: Shape) -> Iterator[Column]:
    if shape.reacts:
        yield Column(
            "reaction_ms",
            "int32",
            "ms",
            "when the operator began to react to the first cue, -1 if never",
        )
    if shape.hand_yields:
        yield Column(
            "hand_mm",
            "float32",
            "mm",
            "how far the cue's force moved a hand at most, before scaling",
        )


def _detector(detector: int, thresholds: int) -> Iterator[Column]:
    name = f"detector{detector}"
    yield Column(f"{name}_score", "float32", "of the detector", "detector: score of the run")
    for threshold in range(thresholds):
        yield Column(
            f"{name}_threshold{threshold}_first_ms",
            "int32",
            "ms",
            "detector: first alarm at this threshold, -1 if none",
        )
        yield Column(
            f"{name}_threshold{threshold}_alarms",
            "int32",
            "",
            "detector: separate alarms at this threshold",
        )


MAY_BE_INFINITE = ("_margin", "_score")
"""Ends of names of columns that are infinite where nothing was ever measured."""

GOLDEN = "golden_"
"""Prefix of what is kept of the golden run's outcome."""
_OF_GOLDEN = re.compile(
    r"(cue|detector)\d+_(first_ms|score)|reaction_ms|hand_mm|tissue_depth_mm|tip_path_mm|pedal_down_ms|halted_ms"
    r"|peak_live_deviation_mm|contact_\w+|cable_load|cable_overload_first_ms|check_\w+_(first_ms|count)"
)


def kept_of_golden(name: str) -> bool:
    """Whether the golden run's outcome of that name is kept beside the run's, as
    `golden_<name>`.
    """
    return _OF_GOLDEN.fullmatch(name) is not None


def _golden(shape: Shape) -> Iterator[Column]:
    robot = robots.find(shape.robot).with_checks(shape.own_checks)
    own = [
        *_course(robot),
        *(column for check in shape.checks for column in _check(robot.check(check))),
        *(column for cue in range(shape.cues) for column in _cue(cue)),
        *_reaction(shape),
        *(
            column
            for d, thresholds in enumerate(shape.detectors)
            for column in _detector(d, thresholds)
        ),
        *_motion(),
        *_cables(shape),
        *_contact(shape),
    ]
    for column in own:
        if kept_of_golden(column.name):
            yield dataclasses.replace(
                column, name=GOLDEN + column.name, meaning=f"golden run: {column.meaning}"
            )


def _motion() -> Iterator[Column]:
    yield Column(
        "peak_model_deviation_mm",
        "float32",
        "mm",
        "largest distance of the tip from the nominal model's",
    )
    yield Column(
        "peak_live_deviation_mm", "float32", "mm", "the same in pedal-down without software E-stop"
    )
    yield Column("rms_model_deviation_mm", "float32", "mm", "root mean square of that distance")
    yield Column(
        "peak_golden_deviation_mm",
        "float32",
        "mm",
        "largest distance of the tip from the golden run's",
    )
    yield Column("rms_golden_deviation_mm", "float32", "mm", "root mean square of that distance")
    yield Column(
        "unintended_mm",
        "float32",
        "mm",
        "largest live distance of the tip from golden run, nominal model and where standing would"
        " have left it",
    )
    yield Column(
        "unintended_first_ms", "int32", "ms", "when that first exceeded the limit, -1 if never"
    )
    yield Column(
        "unintended_off_mm",
        "float32",
        "mm",
        "while not live: largest distance of the tip from the golden run and from where standing"
        " would have left it",
    )
    yield Column(
        "loss_mm",
        "float32",
        "mm",
        "largest live distance from golden run and model by motion that it missed",
    )
    yield Column("loss_first_ms", "int32", "ms", "when that first exceeded the limit, -1 if never")
    yield Column(
        "halted_ms",
        "int32",
        "ms",
        "time in which the operator held the pedal down and the robot was not live",
    )
    yield Column(
        "false_report_mm",
        "float32",
        "mm",
        "largest live distance of the reported tip from the true one, beyond the golden run's",
    )
    yield Column(
        "false_report_first_ms", "int32", "ms", "when that first exceeded the limit, -1 if never"
    )
    yield Column(
        "idle_ms",
        "int32",
        "ms",
        "time in which the golden run's tip moved, > 1 um/ms, and this one less than 1/4",
    )
    yield Column("largest_step_mm", "float32", "mm", "largest motion of the tip within 1 ms")
    yield Column("tip_path_mm", "float32", "mm", "way of the tip")
    yield Column(
        "jump_code",
        "bool",
        "",
        "step of the measured tip over jump_step_mm on 2 packets in a row, golden run's not"
        " (published code)",
    )
    yield Column("jump_code_first_ms", "int32", "ms", "when first, -1 if never")
    yield Column(
        "jump_text",
        "bool",
        "",
        "motion of the true tip over large_jump_mm within 2 ms (published text)",
    )
    yield Column("jump_text_first_ms", "int32", "ms", "when first, -1 if never")
    yield Column(
        "jump_tip",
        "bool",
        "",
        "step of the true tip over jump_step_mm in 2 ticks in a row, golden run's not",
    )
    yield Column("jump_tip_first_ms", "int32", "ms", "when first, -1 if never")
    yield Column(
        "tissue_depth_mm", "float32", "mm", "deepest penetration of the phantom tissue, 0 if none"
    )
    yield Column(
        "tip_distance_mm", "float32", "mm", "smallest distance of the two tips, NaN with one arm"
    )


OVERLOAD = "cable_overload"
"""Column of the first cable that was overloaded."""


def _cables(shape: Shape) -> Iterator[Column]:
    if shape.cables:
        yield Column("cable_load", "float32", "1", "largest tension of a cable, by its strength")
        yield Column(
            "cable_overload_first_ms", "int32", "ms", "when that was first above 1, -1 if never"
        )
        yield Column(OVERLOAD, "category", "", 'that cable, "<arm> <joint>", "" if none')


def _contact(shape: Shape) -> Iterator[Column]:
    if shape.contact:
        yield Column(
            "contact_peak_n", "float32", "N", "largest force of tissue and vessel on an instrument"
        )
        yield Column(
            "contact_impulse_n_s",
            "float32",
            "N s",
            "that force over the run, summed over instruments",
        )
        yield Column(
            "contact_vessel_peak_n", "float32", "N", "largest force of the vessel on an instrument"
        )
    if shape.contact and len(shape.arms) > 1:
        yield Column(
            "contact_instruments_peak_n",
            "float32",
            "N",
            "largest force between the two instruments",
        )


# --- Arrow ----------------------------------------------------------------------------------------
# --------------------


@functools.cache
def arrow_schema(shape: Shape) -> pa.Schema:
    """Arrow schema of the table; unit and meaning travel in each field's metadata."""
    return pa.schema(
        [
            pa.field(
                c.name,
                _arrow_type(c.dtype),
                nullable=False,
                metadata={"unit": c.unit, "meaning": c.meaning},
            )
            for c in columns(shape)
        ],
        metadata={"ravenjax.schema_version": str(VERSION)},
    )


def _arrow_type(dtype: str) -> pa.DataType:
    return (
        pa.dictionary(pa.int32(), pa.string()) if dtype == "category" else pa.type_for_alias(dtype)
    )


def conform(columns: Columns, shape: Shape) -> pa.Table:
    """Columns, or a DataFrame, as an Arrow table of exactly the schema's columns and types, in
    order.

    Raises StoreError for a column that is missing, unknown or holds a value that its type cannot.
    """
    schema = arrow_schema(shape)
    names = schema.names
    missing = [name for name in names if name not in columns]
    unknown = [str(name) for name in columns if name not in names]
    if missing or unknown:
        raise StoreError(_mismatch(missing, unknown, names))
    return pa.Table.from_arrays(
        [_array(columns[field.name], field) for field in schema], schema=schema
    )


def _array(values: Any, field: pa.Field) -> pa.Array:
    """One column in its field's type; missing text is "", so that a reader meets one kind of
    nothing.
    """
    try:
        if pa.types.is_dictionary(field.type):
            return words.arrow(values)
        if pa.types.is_string(field.type):
            if isinstance(values, pa.StringArray) and not values.null_count:
                return values
            return pa.array(values, pa.string(), from_pandas=True).fill_null("")
        array = words.arrow_numbers(_narrowed(np.asarray(values), field.type))
        if array is None:
            array = pa.array(np.asarray(values), from_pandas=False)
        if array.null_count:
            raise pa.ArrowInvalid("a value is missing")
        if pa.types.is_boolean(field.type) and not pa.types.is_boolean(array.type):
            raise pa.ArrowInvalid("only true and false fit")
        return array if array.type == field.type else array.cast(field.type)
    except (pa.ArrowException, OverflowError, TypeError, ValueError) as error:
        got = getattr(values, "dtype", type(values).__name__)
        raise StoreError(
            f"result column {field.name!r} must hold {field.type}, got {got}: {error}"
        ) from error


def _narrowed(values: np.ndarray, kind: pa.DataType) -> np.ndarray:
    """Whole numbers in a column's type if they all fit, as Arrow has them but for the import of
    its functions.
    """
    if (
        values.dtype.kind != "i"
        or not pa.types.is_signed_integer(kind)
        or values.dtype == kind.to_pandas_dtype()
    ):
        return values
    narrow = values.astype(kind.to_pandas_dtype())
    return narrow if (narrow == values).all() else values


def require_columns(shape: Shape, names: Sequence[str]) -> None:
    """StoreError where a table of this shape lacks one of these columns."""
    expected = [column.name for column in columns(shape)]
    if unknown := [name for name in names if name not in expected]:
        raise StoreError(_mismatch([], unknown, expected))


def _mismatch(missing: list[str], unknown: list[str], known: Sequence[str]) -> str:
    parts = []
    if missing:
        parts.append(f"the result table lacks {len(missing)} column(s): {', '.join(missing[:6])}")
    for name in unknown[:6]:
        near = difflib.get_close_matches(name, missing or known, n=1)
        parts.append(
            f"unknown result column {name!r}" + (f", did you mean {near[0]!r}?" if near else "")
        )
    return "; ".join(parts)
