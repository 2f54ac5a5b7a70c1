"""What was said to a session: with scenario and seed the whole of it, kept as JSON, a fraction
of what objects take.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

MOST_HEARD = 1_000_000
"""Commands that are kept: hours of a page's, a quarter of an hour of a console's that sends one
a millisecond.
"""


class Heard:
    """Commands with the tick that each came in: iterated, pairs of both."""

    def __init__(self) -> None:
        self._lines: list[bytes] = []

    def add(self, tick: int, commands: list[dict[str, Any]]) -> None:
        """What was said in a tick."""
        for command in commands:
            if len(self._lines) < MOST_HEARD:
                self._lines.append(json.dumps([tick, command], separators=(",", ":")).encode())

    def clear(self) -> None:
        """Forget all."""
        self._lines.clear()

    def __len__(self) -> int:
        return len(self._lines)

    def __iter__(self) -> Iterator[tuple[int, dict[str, Any]]]:
        for line in self._lines:
            tick, command = json.loads(line)
            yield tick, command

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Heard) and self._lines == other._lines

    __hash__ = None  # type: ignore[assignment]
