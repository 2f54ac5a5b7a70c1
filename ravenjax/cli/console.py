"""Where commands print, and the words that several of them share."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

out = Console()
err = Console(stderr=True)

Overrides = Annotated[
    list[str] | None,
    Parameter(
        name="--set",
        consume_multiple=True,
        negative="",
        help="key.path=value, as campaign.duration_s=5 or group.0.runs=100",
    ),
]
