"""Defines the result table: one row per run, with input columns and outcome columns.

Each column has a name, the smallest type that can store it, a unit and a meaning, listed in
columns.csv.j2 and in the robot's template. results/README.md describes them in prose. The names of
repeated columns (fault slots, cues, checks, arms, varied parameters) depend on a `Shape`.
"""

import csv
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
import pyarrow as pa

from ravenjax import resources, robots
from ravenjax.errors import StoreError, suggest_name
from ravenjax.vocabulary import checks
from ravenjax.vocabulary.checks import Check

if TYPE_CHECKING:
    import pandas as pd

VERSION = 1
"""Version of the schema. It increases if a column changes, but not for a new column."""

Columns: TypeAlias = "Mapping[str, Any] | pd.DataFrame"
"""Columns by name, arrays [rows]."""


class Column(NamedTuple):
    """One column of the result table."""

    name: str
    dtype: str  # name of an Arrow type, or "category" for dictionary-encoded words
    unit: str
    meaning: str
    golden: str = ""  # "golden": the table also has the golden run's value, as `golden_<name>`


_USUAL = robots.find_robot(robots.DEFAULT)


@dataclass(frozen=True)
class Shape:
    """Counts and names on which the columns of a campaign's table depend."""

    robot: str = robots.DEFAULT  # name for `robots.find_robot`
    arms: tuple[str, ...] = _USUAL.arms[:1]
    joints: tuple[str, ...] = _USUAL.joints
    slots: int = 1  # number of fault slots of a run
    cues: int = 1  # number of haptic sets
    checks: tuple[str, ...] = tuple(_USUAL.checks)
    parameters: tuple[str, ...] = ()  # paths of the varied parameters
    stages: tuple[str, ...] = ()  # optional stages of the robot's tick, which have columns
    detectors: tuple[int, ...] = ()  # number of thresholds of each detector
    harms: tuple[str, ...] = ()  # names of harms that the campaign defines
    observes: bool = False  # runs end some time after their last fault
    own_checks: tuple[Check, ...] = ()  # the user's checks
    stops: bool = False  # a detector may stop the robot


@functools.cache
def table_columns(shape: Shape) -> tuple[Column, ...]:
    """Return all columns of a campaign's table, in order."""
    robot = robots.find_robot(shape.robot).with_checks(shape.own_checks)
    text = resources.render_text(
        *robot.columns,
        Path(__file__).with_name("columns.csv.j2"),
        shape=shape,
        levels=", ".join(f"{number} {name}" for number, name in enumerate(robot.run_levels)),
        checks=[robot.check(name) for name in shape.checks],
        needs_own_columns=checks.needs_own_columns(shape.own_checks, shape.stops),
    )
    rows: list[Column] = []
    for name, *others in csv.reader(text.splitlines(keepends=True)):
        if others:
            rows.append(Column(name, *others))
            continue
        # A line with one cell marks the place of the golden run's columns. They repeat the columns
        # above that are marked as `golden`.
        for column in [column for column in rows if column.golden]:
            meaning = f"golden run: {column.meaning}"
            rows.append(Column(GOLDEN + column.name, column.dtype, column.unit, meaning))
    return tuple(rows)


OBSERVED = "observed_ms"
"""Column of the time at which a run ended."""
MAY_BE_INFINITE = ("_margin", "_score")
"""Endings of column names that are infinite if nothing was measured."""

GOLDEN = "golden_"
"""Prefix of columns with outcomes of the golden run."""


def golden_outcomes(shape: Shape) -> list[str]:
    """Return the outcomes whose value in the golden run is stored, as `golden_<name>`."""
    return [column.name for column in table_columns(shape) if column.golden]


# --- Arrow


@functools.cache
def arrow_schema(shape: Shape) -> pa.Schema:
    """Return the Arrow schema of the table, with unit and meaning in each field's metadata."""
    word_type = pa.dictionary(pa.int32(), pa.string())
    fields = []
    for c in table_columns(shape):
        kind = word_type if c.dtype == "category" else pa.type_for_alias(c.dtype)
        metadata = {"unit": c.unit, "meaning": c.meaning}
        fields.append(pa.field(c.name, kind, nullable=False, metadata=metadata))
    return pa.schema(fields, metadata={"ravenjax.schema_version": str(VERSION)})


def conform_table(columns: Columns, shape: Shape) -> pa.Table:
    """Return columns as an Arrow table with exactly the schema's columns and types, in order. Raise
    StoreError for a missing or unknown column, or a value that its type cannot represent.
    """
    schema = arrow_schema(shape)
    names = schema.names
    missing = [name for name in names if name not in columns]
    unknown = [str(name) for name in columns if name not in names]
    if missing or unknown:
        raise StoreError(_mismatch(missing, unknown, names))
    arrays = [_array(columns[field.name], field) for field in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


def _array(values, field: pa.Field) -> pa.Array:
    # Converts values to the column's type, and refuses values that would change.
    try:
        if pa.types.is_dictionary(field.type):
            return arrow_words(values)
        if pa.types.is_string(field.type):
            if isinstance(values, pa.StringArray) and not values.null_count:
                return values
            return pa.array(values, pa.string(), from_pandas=True).fill_null("")
        array = pa.array(np.asarray(values), from_pandas=False)
        if array.null_count:
            raise pa.ArrowInvalid("a value is missing")
        if pa.types.is_boolean(field.type) and not pa.types.is_boolean(array.type):
            raise pa.ArrowInvalid("expected only true and false")
        return array if array.type == field.type else array.cast(field.type)
    except (pa.ArrowException, OverflowError, TypeError, ValueError) as error:
        got = getattr(values, "dtype", type(values).__name__)
        raise StoreError(
            f"result column {field.name!r}: expected type {field.type}, got {got}: {error}"
        ) from error


def word_column(indices: np.ndarray, words: Sequence[str]) -> "pd.Categorical":
    """Return a column of words from their indices in the list `words`, which may repeat words.
    Words that occur become the categories, in the order of the list.
    """
    import pandas as pd

    codes, categories = pd.factorize(np.array(words, object))
    return pd.Categorical.from_codes(codes[indices], categories).remove_unused_categories()


def arrow_words(words: Any) -> pa.DictionaryArray:
    """Return words [rows], categorical or not, as a dictionary-encoded Arrow array. A missing word
    becomes "".
    """
    import pandas as pd

    column = pd.Categorical(words)
    if (column.codes < 0).any():
        column = column.add_categories([""] if "" not in column.categories else [])
        column = column.fillna("")
    if not all(isinstance(word, str) for word in column.categories):
        raise pa.ArrowTypeError(f"got {column.categories[0]!r}, expected words")
    words = pa.array(column.categories, pa.string())
    return pa.DictionaryArray.from_arrays(column.codes.astype(np.int32), words)


def require_columns(shape: Shape, names: Sequence[str]) -> None:
    """Raise StoreError if a table of this shape lacks one of these columns."""
    expected = [column.name for column in table_columns(shape)]
    if unknown := [name for name in names if name not in expected]:
        raise StoreError(_mismatch([], unknown, expected))


def _mismatch(missing: list[str], unknown: list[str], known: Sequence[str]) -> str:
    # Returns a message about missing and unknown columns, at most six of each. An unknown name is
    # probably a misspelling of a missing column, or else of a column of the schema, `known`.
    parts = []
    if missing:
        parts.append(f"the result table lacks {len(missing)} column(s): {', '.join(missing[:6])}")
    parts += [
        f"unknown result column {name!r}{suggest_name(name, missing or known)}"
        for name in unknown[:6]
    ]
    return "; ".join(parts)
