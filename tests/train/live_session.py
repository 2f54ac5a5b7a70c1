"""A session as a user starts one, `ravenjax train` as a process of its own, and a console over the
network beside it.

The console speaks the protocol's description alone (`itp_client`); it sends a packet a few
milliseconds, from a thread.
"""

import subprocess
import sys
import threading
import time

import waiting
from itp_client import Console


class LiveSession:
    """`lines` as they are printed; the addresses of its roles and of its console's port, once
    they are known.
    """

    def __init__(self, scenario, folder, *options):
        words = ["train", scenario, "--out", folder, "--port", 0, "--itp-port", 0, "--linger", 1]
        self.folder, self.lines = folder, []
        self._process = subprocess.Popen(
            [sys.executable, "-m", "ravenjax.cli", *map(str, words), *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        threading.Thread(target=self._listen, daemon=True).start()
        self.said("realtime: ")
        self.operator = self.said("operator: ")
        self.instructor = self.said("instructor: ")
        host, _, port = self.said("console: ITP over UDP ").rpartition(":")
        self.console = (host, int(port))

    def said(self, begin):
        """The rest of the first line that begins so."""
        here = lambda: [line for line in self.lines if line.startswith(begin)]  # noqa: E731
        waiting.until(lambda: here() or self._process.poll() is not None)
        assert here(), "".join(self.lines)
        return here()[0].removeprefix(begin).strip()

    def ended(self):
        """Until it is over; its exit code."""
        return self._process.wait(waiting.DEADLINE_S)

    def close(self):
        if self._process.poll() is None:
            self._process.terminate()
            self._process.wait(waiting.DEADLINE_S)

    def _listen(self):
        for line in self._process.stdout:
            self.lines.append(line)


class HeldConsole:
    """An ITP console whose foot does what `pedal` says and whose hand goes `um` along its first
    axis in each packet.
    """

    EVERY_S = 0.004

    def __init__(self, address):
        self.pedal, self.um, self.sent = 0, 0, 0
        self._console = Console(address)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def told(self):
        """The newest force packet."""
        self._console.drain()
        return self._console.force()

    def close(self):
        self._stop.set()
        self._thread.join()
        self._console.close()

    def _work(self):
        while not self._stop.is_set():
            self._console.send(gold=(self.um if self.pedal else 0, 0, 0), surgeon_mode=self.pedal)
            self.sent += 1
            time.sleep(self.EVERY_S)
