"""The hub alone, without a process and a network: who may say what when a window comes back."""

from __future__ import annotations

import asyncio
import json
from types import SimpleNamespace

import pytest

from ravenjax.train.page import PageOptions
from ravenjax.train.page.hub import Hub
from ravenjax.train.realtime.ring import COMMAND_BYTES, Ring, read_json

OPTIONS = PageOptions("frames", "events", "commands", ("gold",), {})
PRESSED = json.dumps({"type": "input", "source": "keyboard", "pedal": True, "arms": {}})


class Socket:
    """A window's connection: gives what is put into it, whether the hub has closed it or not."""

    def __init__(self, window):
        self.request = SimpleNamespace(path=f"/session?role=operator&window={window}")
        self.messages, self.sent, self.closed = asyncio.Queue(), [], False

    async def send(self, message):
        self.sent.append(message)

    async def close(self, **_):
        self.closed = True

    def __aiter__(self):
        return self

    async def __anext__(self):
        message = await self.messages.get()
        if message is None:
            raise StopAsyncIteration
        return message

    async def say(self, message):
        self.messages.put_nowait(message)
        for _ in range(10):
            await asyncio.sleep(0)


@pytest.fixture
def ring():
    made = Ring.create(64, COMMAND_BYTES)
    yield made
    made.close()


def test_what_the_old_connection_of_a_window_still_says_is_not_the_operators(ring):
    async def scene():
        hub = Hub(OPTIONS, {}, ring, lambda *_: None, lambda: None)
        old, new = Socket("mine"), Socket("mine")
        serving = [asyncio.create_task(hub.serve(old))]
        await old.say(PRESSED)
        serving.append(asyncio.create_task(hub.serve(new)))
        await new.say(PRESSED)
        await old.say(PRESSED)
        ends = old.closed, new.closed, json.loads(new.sent[0])["role"]
        for socket in (old, new):
            await socket.say(None)
        await asyncio.gather(*serving)
        return ends

    assert asyncio.run(scene()) == (True, False, "operator")
    said = [one.get("do", one["type"]) for one in read_json(ring.read(0)[1])]
    assert said == ["input", "left", "input", "left"]  # the old one's second word is not there
