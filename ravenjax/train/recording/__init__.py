"""What a session writes while it runs, read back."""

from __future__ import annotations

import contextlib
from multiprocessing.connection import Connection


def run_when_told(told: Connection) -> None:
    """Import, then record with the `recorder.RecorderOptions` that come through `told`;
    it answers there once the file is made.
    """
    import numpy as np

    from ravenjax.store.logs.topics import quaternions
    from ravenjax.train.recording import recorder

    quaternions(np.eye(3)[None])  # imports what it needs
    with contextlib.suppress(EOFError):  # the session ended before it began
        recorder.run(told.recv(), lambda: told.send(None))
