"""Prevents two processes from writing to a result folder at the same time.

The second process is refused, with the name of the first. The lock is that of the operating system
(`flock` on `DIR/.lock`), so it ends with the process that locked the folder. The file only stores
the name of this process. On NFS, Linux passes `flock` to the server. On a file system without
locks, the file decides: a folder is refused if the named process is on another host or still runs.
"""

import contextlib
import errno
import fcntl
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel, ValidationError

from ravenjax.errors import StoreError
from ravenjax.store.files import EXPECTED_FOLDER, disk_errors
from ravenjax.store.manifest import utc_now

FILE = ".lock"
_TAKEN = (errno.EWOULDBLOCK, errno.EACCES)
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)


class Holder(BaseModel):
    """Content of the file: the process that holds the lock."""

    pid: int
    host: str
    since: str


@contextlib.contextmanager
def hold_lock(folder: Path) -> Iterator[None]:
    """Lock `folder`, which must exist, until the end of the block. Raise StoreError with the name
    of the process if another process has locked it.
    """
    path = folder / FILE
    with disk_errors(f"{path}: cannot be written", EXPECTED_FOLDER):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
    with open(descriptor, "r+", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (*_TAKEN, *_NO_LOCKS):
                raise StoreError(f"{path}: cannot be locked ({error.strerror or error})") from error
            holder = None
            with contextlib.suppress(ValidationError):
                holder = Holder.model_validate_json(file.read())
            if error.errno in _TAKEN:
                raise _refusal(folder, holder) from None
            if holder is not None and _may_run(holder):
                hint = f" This file system has no locks: if that process has ended, delete {path}."
                raise _refusal(folder, holder, hint) from None
        holder = Holder(pid=os.getpid(), host=socket.gethostname(), since=utc_now())
        # The lock works without the content of the file, so a full disk is no error.
        with contextlib.suppress(OSError):
            _put(file, holder.model_dump_json())
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                _put(file, "")


def _put(file, text: str):
    file.seek(0)
    file.truncate()
    file.write(text)
    file.flush()


def _may_run(holder: Holder) -> bool:
    # Returns whether the process may still run. On another computer this is unknown: True.
    try:
        if holder.host == socket.gethostname():
            # Signal 0 does nothing, but fails if the process does not exist.
            os.kill(holder.pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        # It is the process of another user.
        pass
    return True


def _refusal(folder: Path, holder: Holder | None, hint: str = "") -> StoreError:
    # Returns the error for a folder that another process has locked. hint: a further sentence.
    who = "another process"
    if holder is not None:
        who = f"process {holder.pid} on {holder.host}, started {holder.since},"
    return StoreError(
        f"{folder}: {who} is writing into this folder. Wait for this process, stop it, or name"
        f" another folder with --out.{hint} Nothing was changed."
    )
