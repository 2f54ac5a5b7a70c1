"""Writes and reads the recording of a session."""

import contextlib
from multiprocessing.connection import Connection


def run_when_told(session: Connection) -> None:
    """Import the recorder, then record with the arguments of `record_session` that arrive.

    The answer is None, once the recording file exists.
    """
    from ravenjax.train.recording import recorder

    with contextlib.suppress(EOFError):  # the session ended before it began
        recorder.record_session(*session.recv(), listening=lambda: session.send(None))
