"""Exceptions for errors that a user can correct, and functions that write their messages."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterable, Sequence


class UserError(ValueError):
    """Raised for an error in the user's input. The message names the file, key or value, the
    expected values, and what to write instead.

    The command line prints the message without a traceback and exits with code 2.
    """


class StoreError(Exception):
    """Raised for a result folder or file that cannot be used. The message names the file, the
    problem, and what to do.
    """


_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother, _SHORT.maxlong = 3, 80, 80, 40


def format_value(value: object) -> str:
    """Return the repr of a value for an error message, shortened if it is long."""
    try:
        return _SHORT.repr(value)
    # A repr may raise anything. The caller still needs the error message.
    except Exception:
        return f"<{type(value).__name__}>"


def list_lines(lines: Sequence[str], most: int = 8) -> str:
    """Return a text with the first `most` lines, indented, and the number of further lines."""
    more = [f"and {len(lines) - most} more"] if len(lines) > most else []
    return "\n".join(f"  {line}" for line in [*lines[:most], *more])


def suggest_name(word: object, names: Iterable[str]) -> str:
    """Return `. Did you mean 'x'?` with the known name that is most similar to `word`.

    Return "" if no name is similar, or if `word` is not a string.
    """
    if not isinstance(word, str):
        return ""
    names = list(names)
    same = [one for one in names if one.lower() == word.lower()]
    near = same or difflib.get_close_matches(word, names, n=1, cutoff=0.5)
    return f". Did you mean {near[0]!r}?" if near else ""


def describe_unknown_name(what: str, word: str, names: Iterable[str]) -> str:
    """Return the error message for a word that is not among the known names."""
    names = list(names)
    return f"unknown {what} {word!r}, expected one of {', '.join(names)}{suggest_name(word, names)}"
