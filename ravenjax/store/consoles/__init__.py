"""Reads a console profile: a TOML file, or the name of a bundled profile."""

import functools
import tomllib
from pathlib import Path

from pydantic import ValidationError

from ravenjax.errors import UserError, find_mistakes, format_value, list_lines, suggest_name
from ravenjax.robots.raven2.console.profile import ConsoleProfile

AUTO = "auto"
_SUFFIX = ".toml"


@functools.cache
def bundled_profiles() -> tuple[ConsoleProfile, ...]:
    """Return all bundled console profiles. The first is `raven`, the protocol of the Raven-II."""
    files = sorted(Path(__file__).parent.glob(f"*{_SUFFIX}"))
    profiles = [_checked(file.name, file.read_text(encoding="utf-8")) for file in files]
    return tuple(sorted(profiles, key=lambda profile: profile.name != "raven"))


def load_profile(name: str) -> ConsoleProfile:
    """Return the console profile with a bundled name, or of a .toml file. Raise UserError."""
    by_name = {profile.name: profile for profile in bundled_profiles()}
    if name in by_name:
        return by_name[name]
    path = Path(name)
    if path.suffix != _SUFFIX:
        words = ", ".join([*by_name, AUTO])
        raise UserError(
            f"console {format_value(name)} is unknown, expected one of {words}, or a .toml file"
            f"{suggest_name(name, [*by_name, AUTO])}"
        )
    try:
        # Some editors write a byte order mark at the beginning.
        text = path.read_text(encoding="utf-8-sig")
    # ValueError: the text is not UTF-8, or the path contains a zero byte.
    except (OSError, ValueError) as error:
        raise UserError(
            f"{path}: the console profile cannot be read: {error}; expected a TOML file"
        ) from None
    return _checked(str(path), text)


def profile_choices(name: str) -> tuple[ConsoleProfile, ...]:
    """Return the profile `name`, or all bundled profiles for "auto". Raise UserError."""
    return bundled_profiles() if name == AUTO else (load_profile(name),)


def _checked(where: str, text: str) -> ConsoleProfile:
    # Reads a profile from TOML text. where: name of the file for error messages.
    raw = None
    try:
        raw = tomllib.loads(text)
        return ConsoleProfile.model_validate(raw)
    except ValidationError as error:
        lines = [
            f"{'.'.join(map(str, key)) or 'the file'}: {message}"
            for key, message in find_mistakes(error, ConsoleProfile, raw)
        ]
        raise UserError(f"{where}: is not a valid console profile:\n{list_lines(lines)}") from None
    # tomllib also raises ValueError for a number with thousands of digits.
    except (ValueError, RecursionError) as error:
        raise UserError(f"{where}: not a TOML file: {error}") from None
