"""The robot as a process: what reaches it, what it reports, what it obeys."""

import json
import socket
from types import SimpleNamespace

import pytest
import waiting
from itp_client import Clock, Console, datagram

from ravenjax.train import scenario
from ravenjax.train.protocol import Frame, FrameLayout
from ravenjax.train.robot_link.itp import STILL, Gate, ItpConsole, ItpServer
from ravenjax.train.robot_link.joint_stream import JointServer
from ravenjax.train.robot_link.process import JointConsole, PacketSession

BOTH = ("gold", "green")


class Integrator:
    """A robot that takes all packets, and remembers its orders."""

    arms = BOTH
    blueprint = SimpleNamespace(plan=SimpleNamespace(runs=4))

    def __init__(self):
        self.frame, self.packets, self.orders = Frame(FrameLayout.of(BOTH)), [], []
        self.frame["last_seq"] = 111

    def tick(self, packet):
        if packet is not None:
            self.packets.append(packet)
            self.frame["last_seq"] = packet.sequence
        return self.frame

    def arm(self, row):
        self.orders.append(("arm", row))

    def disarm(self):
        self.orders.append(("disarm",))

    def press_estop(self, row):
        self.orders.append(("press", row))

    def outcomes(self):
        limit = {"check_joint_limit_count": 13308, "check_joint_limit_first_ms": 2}
        return limit | {"check_estop_count": 0, "check_estop_first_ms": -1}

    def reset(self):
        self.orders.append(("reset",))
        self.frame["last_seq"] = 111


class Rig:
    """A robot's session with open ports, a console and a listener beside it."""

    def __init__(self, machine, hazards=3):
        self.clock = Clock()
        self.itp = ItpServer(Gate(machine.arms), port=0, clock=self.clock)
        self.joints = JointServer({"robot": "ravenjax", "arms": list(machine.arms)}, "127.0.0.1", 0)
        self.session = PacketSession(scenario.from_dict({"name": "robot"}), machine)
        self.consoles = [
            JointConsole(self.joints, self.itp, self.session, hazards),
            ItpConsole(self.itp, self.session),
        ]
        self.machine = machine
        self.console = Console(self.itp.address)
        self.listener = socket.create_connection(self.joints.address)
        self.listener.settimeout(waiting.DEADLINE_S)
        self.rest, self.said = b"", []

    def tick(self, count=1, *crtk):
        for _ in range(count):
            self.clock.ms += 1.0
            self.session.move([*(c for each in self.consoles for c in each.poll()), *crtk])
            for each in self.consoles:
                each.send_frame(self.session.frame)
            self.session.conclude()

    def report(self):
        """The report of the newest tick."""
        tick = self.session.ticks - 1
        while not self.said or self.said[-1].get("tick") != tick:
            *lines, self.rest = (self.rest + self.listener.recv(1 << 16)).split(b"\n")
            self.said += map(json.loads, lines)
        return self.said[-1]

    def answers(self):
        return [one for one in self.said if "answer" in one]

    def ask(self, **order):
        """Send an order; the answer."""
        before = len(self.answers())
        self.listener.sendall(json.dumps(order).encode() + b"\n")
        waiting.until(
            lambda: (self.tick(), self.report(), len(self.answers()) > before)[2], every_s=0.002
        )
        return self.answers()[-1]


@pytest.fixture
def rig():
    made = Rig(Integrator())
    yield made
    for part in (made.console, made.listener, made.itp, made.joints):
        part.close()


def test_what_the_checks_did_is_told_now_and_then(rig):
    rig.machine.frame["tick"], rig.machine.frame["trips"] = 42, 13308
    rig.tick(150)
    assert rig.report()["checks"] == {"joint_limit": [13308, 100 - 40]}


@pytest.mark.parametrize("why", ["beginning", "silence", "estop", "reset"])
def test_a_pedal_of_a_console_counts_after_it_was_seen_up(rig, why):
    def press(mode, count=3):
        del rig.machine.packets[:]
        for _ in range(count):
            rig.console.send(surgeon_mode=mode)
            rig.tick()
        return [packet.surgeon_mode for packet in rig.machine.packets]

    if why != "beginning":
        press(0)
        assert press(1) == [1, 1, 1]
    if why == "silence":
        rig.tick(300)
    elif why in ("estop", "reset"):
        rig.ask(order=why)
    assert press(1) == [0, 0, 0]
    assert press(0) == [0, 0, 0] and press(1) == [1, 1, 1]


def test_pedals_alone_decide_between_itp_and_crtk(rig):
    def press(itp, crtk, count=3):
        del rig.machine.packets[:]
        for _ in range(count):
            moved = dict.fromkeys(BOTH, STILL | {"delta_um": [7, 0, 0]})
            hands = {"type": "increments", "console": "crtk", "pedal": crtk, "arms": moved}
            if itp is not None:
                rig.console.send(surgeon_mode=itp)
            rig.tick(1, *([] if crtk is None else [hands]))
        return [(packet.surgeon_mode, packet.delta[0][0]) for packet in rig.machine.packets]

    press(0, False)
    assert press(1, False) == [(1, 0)] * 3
    assert press(1, True) == [(1, 0)] * 3
    assert press(0, True) == [(0, 0)] * 3, "a pedal pressed meanwhile must be lifted first"
    press(0, False)
    assert press(0, True) == [(1, 7)] * 3, "the other pedal is up"
    assert press(None, None, 260)[-1:] == [(0, 0)], "the CRTK process is gone"


def test_the_robot_sees_a_stream_without_gaps_and_reports_the_consoles_numbers(rig):
    for number in (1, 2, 5, 6, 7):  # 5 comes after a gap and is lost
        rig.console.send_bytes(datagram(number, gold=(1, 0, 0)))
        rig.tick()
    assert [p.sequence for p in rig.machine.packets] == [1, 2, 3, 4]
    assert rig.report()["last_seq"] == 7


def test_orders(rig):
    assert rig.ask(order="arm", number=2) == {"answer": "arm", "ok": True}
    assert rig.ask(order="disarm")["ok"]
    assert rig.ask(order="estop")["ok"]
    rig.console.send()
    rig.tick()
    assert rig.ask(order="reset")["ok"]
    rig.console.send()
    rig.tick()
    assert rig.machine.orders == [("arm", 2), ("disarm",), ("press", 3), ("reset",)]
    assert rig.machine.packets[-1].sequence == 1, "a robot that is reset hears a new stream"
    assert rig.report()["last_seq"] == 2, "which is the console's old one"
