"""Refuses to run Python code that a campaign file names, until the user has agreed to it.

Such code is a user's file, such as a check, or the module of a robot. The user agrees to code in
one of these ways:

- A command names a campaign file by its path, and the code belongs to the user and lies in the
  folder of the campaign file. The module of a robot may lie anywhere in Python's search path.
- `--trust` is on the command line, or RAVENJAX_TRUST=1 in the environment.
- The user agreed to the same content before. A hash of the content is stored. For a robot this
  covers all Python files of its package, or its module and the files in its folder that it imports.

A result folder and `ravenjax check` therefore run only code that the user has run before.
"""

import contextlib
import hashlib
import os
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from pathlib import Path

from ravenjax.errors import UserError

VARIABLE = "RAVENJAX_TRUST"
"""Environment variable: 1 lets all code run that a file names."""
EVERYWHERE = Path("/")
OWNERS = (0, os.geteuid())
"""Users whose files are as safe as the user's own: root and the user."""

_FOLDERS: ContextVar[tuple[Path, ...]] = ContextVar("folders", default=())


@contextlib.contextmanager
def given_for(*folders: Path) -> Iterator[None]:
    """Let the code in these folders run, in addition to code that may run anyway."""
    before = _FOLDERS.set((*_FOLDERS.get(), *(folder.resolve() for folder in folders)))
    try:
        yield
    finally:
        _FOLDERS.reset(before)


def require_consent(path: Path, content: bytes, robot: Sequence[Path] = ()) -> None:
    """Raise UserError unless the user agrees that the code in this file runs.

    robot: all files of the robot, if the code is that of a robot. `content` is then that
    of all of them.
    """
    memory = user_folder("XDG_STATE_HOME", ".local/state")
    kind = "robots" if robot else "parts"
    mark = memory and memory / "trusted" / kind / hashlib.sha256(content).hexdigest()
    trusted = os.environ.get(VARIABLE) == "1" or EVERYWHERE in _FOLDERS.get()
    place = path.resolve()
    given = any(robot or place.is_relative_to(folder) for folder in _FOLDERS.get())
    if trusted or (given and all(file.stat().st_uid in OWNERS for file in robot or [place])):
        # Without a memory the user is asked again.
        with contextlib.suppress(OSError):
            if mark and is_private(mark.parent):
                mark.touch()
    elif not (mark and is_private(mark.parent) and mark.exists()):
        raise UserError(
            f"{path}: is Python code that you have not run before, and it was not run now. It can"
            " do whatever you can do. Read it, then repeat the command with --trust; in Python, set"
            f" {VARIABLE}=1. `ravenjax run` needs that only for code outside of the campaign's"
            " folder, or of another user"
        )


def user_folder(variable: str, default: str) -> Path | None:
    """Return ravenjax's own folder for one kind of the user's files.

    It is inside the folder that the XDG variable `variable` names. If the variable is not set, it
    is inside `default`, a path relative to the home folder. In this case the result is None for a
    user who has no home folder.
    """
    given = Path(os.environ.get(variable, ""))
    try:
        # The specification says to ignore a relative path.
        return (given if given.is_absolute() else Path.home() / default) / "ravenjax"
    except RuntimeError:
        return None


def is_private(folder: Path) -> bool:
    """Create a folder if needed, and return whether nobody else may write, or wrote, into it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
        owners = {status.st_uid}
        for path in folder.iterdir():
            # Another process may delete a file meanwhile.
            with contextlib.suppress(FileNotFoundError):
                owners.add(path.lstat().st_uid)
    except OSError:
        return False
    return owners <= {*OWNERS} and not status.st_mode & 0o022
