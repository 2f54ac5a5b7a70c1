"""Writes and reads the recording of a session."""

import contextlib
from multiprocessing.connection import Connection


def run_when_told(session: Connection) -> None:
    """Import the recorder, then record with the arguments of `record_session` that arrive. session:
    connection to the session. It gets None once the recording file exists.
    """
    # The recorder needs scipy.spatial, which takes 0.3 s to import.
    import scipy.spatial  # noqa: F401

    from ravenjax.train.recording import recorder

    with contextlib.suppress(EOFError):  # the session ended before it began
        recorder.record_session(*session.recv(), listening=lambda: session.send(None))
