"""Fails if the package or its tests are larger than their limits.

    python .ci/budget.py

Counts Python tokens (names, operators, numbers, strings), lines and modules in `ravenjax/`, and
lines in `tests/`. The package may have at most 450 000 tokens. A change that exceeds a limit
removes the same amount of code elsewhere. Tests may have at most 42 000 lines.
"""

from __future__ import annotations

import io
import sys
import tokenize
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIMITS = {"tokens": 450_000, "lines": 68_000, "modules": 400, "lines of tests": 42_000}
COUNTED = {tokenize.NAME, tokenize.OP, tokenize.NUMBER, tokenize.STRING}


def main() -> int:
    """Print what is used of each limit; 1 where something is over its limit."""
    package = {path: path.read_text() for path in (ROOT / "ravenjax").rglob("*.py")}
    tests = [path.read_text() for path in (ROOT / "tests").rglob("*.py")]
    used = {
        "tokens": sum(map(count_tokens, package.values())),
        "lines": sum(text.count("\n") for text in package.values()),
        "modules": sum(path.name != "__init__.py" for path in package),
        "lines of tests": sum(text.count("\n") for text in tests),
    }
    for name, limit in LIMITS.items():
        over = "  over the limit" if used[name] > limit else ""
        print(f"{name:16}{used[name]:9,} of {limit:9,}{over}")
    return any(used[name] > limit for name, limit in LIMITS.items())


def count_tokens(text: str) -> int:
    """Names, operators, numbers and strings of a module."""
    return sum(
        token.type in COUNTED for token in tokenize.generate_tokens(io.StringIO(text).readline)
    )


if __name__ == "__main__":
    sys.exit(main())
