"""Reads a console profile: a TOML file, or the name of a bundled profile."""

import functools
import tomllib
from pathlib import Path

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from ravenjax.errors import UserError, format_value, list_lines, suggest_name
from ravenjax.robots.raven2.console.profile import ConsoleProfile

AUTO = "auto"
_SUFFIX = ".toml"


@functools.cache
def bundled_profiles() -> tuple[ConsoleProfile, ...]:
    """Return every bundled profile, the robot's native protocol first."""
    files = sorted(Path(__file__).parent.glob(f"*{_SUFFIX}"))
    profiles = [_checked(file.name, file.read_text(encoding="utf-8")) for file in files]
    return tuple(sorted(profiles, key=lambda profile: profile.name != "raven"))


def load_profile(name: str) -> ConsoleProfile:
    """Return the profile of a bundled name or of a .toml file. Raises UserError."""
    by_name = {profile.name: profile for profile in bundled_profiles()}
    if name in by_name:
        return by_name[name]
    path = Path(name)
    if path.suffix != _SUFFIX:
        words = ", ".join([*by_name, AUTO])
        raise UserError(
            f"console {format_value(name)} is not known, expected one of {words}, or a .toml file"
            f"{suggest_name(name, [*by_name, AUTO])}"
        )
    try:
        # Some editors write a byte order mark first.
        text = path.read_text(encoding="utf-8-sig")
    # ValueError: the text is not UTF-8, or the path contains a zero byte.
    except (OSError, ValueError) as error:
        raise UserError(
            f"{path}: the console's profile cannot be read: {error}; expected a TOML file"
        ) from None
    return _checked(str(path), text)


def profile_choices(name: str) -> tuple[ConsoleProfile, ...]:
    """Return the profiles that a console may have: one, or every bundled one for "auto".

    Raises UserError.
    """
    return bundled_profiles() if name == AUTO else (load_profile(name),)


def _checked(where: str, text: str) -> ConsoleProfile:
    try:
        return ConsoleProfile.model_validate(tomllib.loads(text))
    except ValidationError as error:
        raise UserError(
            f"{where}: not a console's profile:\n"
            + list_lines([_line(fault) for fault in error.errors()])
        ) from None
    # tomllib also raises ValueError where a number has thousands of digits.
    except (ValueError, RecursionError) as error:
        raise UserError(f"{where}: not a TOML file: {error}") from None


def _line(fault: ErrorDetails) -> str:
    # Returns one error of a profile as a line: key, what was got, what was expected.
    key = ".".join(map(str, fault["loc"])) or "the file"
    words = str(fault["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")
    if fault["type"] == "extra_forbidden":
        model: type = ConsoleProfile
        for table in fault["loc"][:-1]:
            model = model.model_fields[str(table)].annotation  # type: ignore[attr-defined, assignment]
        keys = list(model.model_fields)  # type: ignore[attr-defined]
        return (
            f"{key}: no such key, expected {', '.join(keys)}{suggest_name(fault['loc'][-1], keys)}"
        )
    if fault["type"] == "missing":
        return f"{key}: missing, expected it in the file"
    if fault["type"] == "value_error":
        return f"{key}: {words}"
    return f"{key}: got {format_value(fault['input'])}, expected {words}"
