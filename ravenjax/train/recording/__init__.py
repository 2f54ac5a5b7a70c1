"""Writes and reads the recording of a session."""

import contextlib
from multiprocessing.connection import Connection


def run_when_told(session: Connection) -> None:
    """Import the recorder, then record with the arguments of `record_session` that arrive.

    The answer is None, once the recording file exists.
    """
    import numpy as np

    from ravenjax.store.logs.topics import rotation_quaternions
    from ravenjax.train.recording import recorder

    rotation_quaternions(np.eye(3)[None])  # a first call does its imports
    with contextlib.suppress(EOFError):  # the session ended before it began
        recorder.record_session(*session.recv(), listening=lambda: session.send(None))
