"""Refuses to run Python code that a campaign file names, until the user has agreed to it.

Such code is a user's file (a check) or a robot's module. The user agrees in one of these ways:

- A command names a campaign file by its path, and the code belongs to the user and lies in the
  folder of the campaign file. The module of a robot may lie anywhere in Python's search path.
- `--trust` is on the command line, or RAVENJAX_TRUST=1 in the environment.
- The user agreed to the same content before. A hash of the content is stored. For a robot, the hash
  covers all Python files of the robot's package. If the robot is a single module, it covers the
  module and the files that the module imports from its own folder.

Without `--trust`, commands that read a result folder, and `ravenjax check`, run only code to which
the user agreed before.
"""

import contextlib
import hashlib
import os
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from pathlib import Path

from ravenjax.errors import UserError

VARIABLE = "RAVENJAX_TRUST"
"""Environment variable; with value 1, all code that a campaign file names may run."""
EVERYWHERE = Path("/")
"""Folder for `trust_folders` if the user agrees to all code."""
OWNERS = (0, os.geteuid())
"""Ids of the users whose files are trusted: root and the current user."""

_FOLDERS: ContextVar[tuple[Path, ...]] = ContextVar("folders", default=())


@contextlib.contextmanager
def trust_folders(*folders: Path) -> Iterator[None]:
    """Within a `with` block, permit the code in these folders and in their subfolders to run."""
    before = _FOLDERS.set((*_FOLDERS.get(), *(folder.resolve() for folder in folders)))
    try:
        yield
    finally:
        _FOLDERS.reset(before)


def require_consent(path: Path, content: bytes, robot: Sequence[Path] = ()) -> None:
    """Raise UserError unless the user has agreed to run the code in this file. content: content of
    the file. robot: for a robot's module, all files of the robot; `content` is then the content of
    all these files. The hash of code that may run is stored, for the next time.
    """
    state_folder = user_folder("XDG_STATE_HOME", ".local/state")
    kind = "robots" if robot else "parts"
    # An empty file whose name is the hash marks code to which the user agreed.
    mark = state_folder and state_folder / "trusted" / kind / hashlib.sha256(content).hexdigest()
    folders, resolved = _FOLDERS.get(), path.resolve()
    trusts_all = os.environ.get(VARIABLE) == "1" or EVERYWHERE in folders
    # A robot's module may lie anywhere, if any folder is trusted.
    in_trusted_folder = bool(folders) if robot else any(map(resolved.is_relative_to, folders))
    files = robot or [resolved]
    # Code may run if all code is trusted, or its folder and its owner, or if it has run before.
    if trusts_all or (in_trusted_folder and all(file.stat().st_uid in OWNERS for file in files)):
        # If the hash cannot be stored, the user must agree again next time.
        with contextlib.suppress(OSError):
            if mark and is_private(mark.parent):
                mark.touch()
    elif not (mark and is_private(mark.parent) and mark.exists()):
        raise UserError(
            f"{path}: this Python file was not run, because you have not run it before and its code"
            " can do whatever you can do. Read it, then repeat the command with --trust; in Python,"
            f" set {VARIABLE}=1. `ravenjax run` needs --trust only for code outside of the"
            " campaign's folder or owned by another user"
        )


def user_folder(variable: str, default: str) -> Path | None:
    """Return ravenjax's folder for one kind of the user's files, such as caches. variable:
    environment variable of the XDG specification that names the parent folder. default: the parent
    folder if the variable is not set, relative to the home folder. Return None if the variable is
    not set and the user has no home folder.
    """
    parent = Path(os.environ.get(variable, ""))
    try:
        # The specification says to ignore a relative path.
        return (parent if parent.is_absolute() else Path.home() / default) / "ravenjax"
    except RuntimeError:
        return None


def is_private(folder: Path) -> bool:
    """Create a folder if needed, and return whether it is safe from other users: none may write
    into it, and none except root owns it or a file in it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
        owners = {status.st_uid}
        for path in folder.iterdir():
            # Another process may delete the file at this moment.
            with contextlib.suppress(FileNotFoundError):
                owners.add(path.lstat().st_uid)
    except OSError:
        return False
    # The bits 0o022 permit the group and all users to write.
    return owners <= {*OWNERS} and not status.st_mode & 0o022
