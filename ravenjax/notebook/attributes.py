"""What the columns of a result table mean, for the attrs of a DataFrame."""

from __future__ import annotations

from ravenjax.store import schema


def described(shape: schema.Shape) -> dict[str, dict[str, str]]:
    """{"units": {column: unit}, "meanings": {column: meaning}}."""
    columns = schema.columns(shape)
    return {
        "units": {column.name: column.unit for column in columns},
        "meanings": {column.name: column.meaning for column in columns},
    }
