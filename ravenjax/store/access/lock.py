"""One writer a result folder: who comes second is refused, and told who holds it.

The lock is the operating system's (`flock` on `DIR/.lock`), so it goes with the process that held
it, however that ended; what stands in the file only says who that was. Linux passes `flock` on NFS
to the server (NFS 4, and 3 with `lockd`), which knows of every client; where a file system offers
no locks at all, the file's words must do: they name a host and a process, and whoever is on another
host, or sees that process run, stays away.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import os
import socket
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from ravenjax.errors import StoreError
from ravenjax.store.files import parsed

FILE = ".lock"
_TAKEN = (errno.EWOULDBLOCK, errno.EACCES)
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold the lock of `folder`, which exists. Raises StoreError naming the holder where another
    process has it.
    """
    path = folder / FILE
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise StoreError(
            f"{path}: cannot be written ({error.strerror or error}). Expected a folder that this"
            " user may create files in; name another one with --out. No run was started."
        ) from error
    with open(descriptor, "r+", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in _TAKEN:
                raise _refusal(folder, file.read(), "") from None
            if error.errno not in _NO_LOCKS:
                raise StoreError(f"{path}: cannot be locked ({error.strerror or error})") from error
            holder = file.read()
            if _may_live(holder):
                raise _refusal(
                    folder,
                    holder,
                    f" This file system has no locks: if that process is gone, delete {path}.",
                ) from None
        with contextlib.suppress(
            OSError
        ):  # a full disk is no reason to refuse: the lock itself holds
            _put(
                file,
                json.dumps({"pid": os.getpid(), "host": socket.gethostname(), "since": _now()}),
            )
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                _put(file, "")


def _put(file, text: str) -> None:
    file.seek(0)
    file.truncate()
    file.write(text)
    file.flush()


def _holder(text: str) -> dict:
    """What a lock file says; nothing where it is torn or empty."""
    try:
        content = parsed(text)
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}


def _may_live(text: str) -> bool:
    holder = _holder(text)
    if not holder:
        return False
    if holder.get("host") != socket.gethostname():
        return True
    try:
        os.kill(int(holder["pid"]), 0)
    except (ProcessLookupError, KeyError, TypeError, ValueError):
        return False
    except PermissionError:  # it is another user's, and there
        pass
    return True


def _refusal(folder: Path, text: str, remedy: str) -> StoreError:
    holder = _holder(text)
    who = (
        f"process {holder.get('pid')} on {holder.get('host')}, since {holder.get('since')}"
        if holder
        else "another process"
    )
    return StoreError(
        f"{folder}: is being written by {who}. Two runs into one folder would do the same work"
        f" twice: wait for it, stop it, or choose another --out.{remedy} Nothing was changed."
    )


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
