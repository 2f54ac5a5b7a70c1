"""Errors that a user can correct, and how their messages are worded."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterable, Sequence


class UserError(ValueError):
    """Bad input: a file, a key, a value. The message names it, says what was expected and what to
    write instead.

    The command line prints it without a traceback and exits with code 2.
    """


class StoreError(Exception):
    """A result folder or file that cannot be used; the message names it, says what is wrong and
    what to do.
    """


_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother, _SHORT.maxlong = 3, 80, 80, 40


def shown(value: object) -> str:
    """The repr of a value in an error message, cut where it is long."""
    try:
        return _SHORT.repr(value)
    except Exception:  # a repr may fail in any way, and its owner still wants the error
        return f"<{type(value).__name__}>"


def listed(lines: Sequence[str], most: int = 8) -> str:
    """The first of some lines below each other, indented, and how many more there are."""
    more = [f"and {len(lines) - most} more"] if len(lines) > most else []
    return "\n".join(f"  {line}" for line in [*lines[:most], *more])


def suggestion(word: object, names: Iterable[str]) -> str:
    """`. Did you mean 'x'?` for the known word nearest to `word`; "" where none is near, or
    `word` is no text.
    """
    if not isinstance(word, str):
        return ""
    names = list(names)
    same = [one for one in names if one.lower() == word.lower()]
    near = same or difflib.get_close_matches(word, names, n=1, cutoff=0.5)
    return f". Did you mean {near[0]!r}?" if near else ""


def unknown(what: str, word: str, names: Iterable[str]) -> str:
    """The message for a word that is not known."""
    names = list(names)
    return f"unknown {what} {word!r}, expected one of {', '.join(names)}{suggestion(word, names)}"
