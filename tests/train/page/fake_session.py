"""A session that fills the rings as the realtime process does, without its physics: joints that
follow the keys.

It answers commands the way a session would (pedal, E-stop, hazards, phases), so that the page can
be tested alone.
"""

import multiprocessing
import socket
import threading
import time

import mujoco
import numpy as np
import waiting

from ravenjax.robots.raven2.dynamics import arm_model
from ravenjax.store.ring import COMMAND_BYTES, EVENT_BYTES, Ring, put_json, read_json
from ravenjax.train import page
from ravenjax.train.protocol import CONSOLES, PHASES, VIEWS, Frame, FrameLayout

FACTS = ("number", "hazard", "title", "group", "right_response", "within_s")
HAZARDS = (
    ("C09", "Encoder of the shoulder jumps", "encoder", ["release"], 1.0),
    ("L7", "Elbow command overwritten after the checks", "usb", ["release", "estop"], 2.0),
)
PLACES = (("gold", -0.03, -0.02, 0.19), ("green", 0.01, 0.02, 0.195), ("gold", -0.01, -0.01, 0.19))
HEADER = {
    "version": 1,
    "name": "reach-20260101-120000",
    "scenario": {"title": "Three targets", "description": "Reach each target and hold it."},
    **{"seed": 7, "participant": "p01", "group": "cue", "cue": True, "blinded": False},
    **{"arms": ["gold", "green"], "robot": "virtual", "cue_threshold_mm": 3.0},
    "hazards": [dict(zip(FACTS, (k, *hazard), strict=True)) for k, hazard in enumerate(HAZARDS)],
    "task": {
        "kind": "reach",
        "targets": [
            {"number": k, "arm": arm, "at": at, "radius_m": 0.003, "colour": "#d9a441"}
            for k, (arm, *at) in enumerate(PLACES)
        ],
    },
}
INSTRUCTOR = "the-instructor's"
"""What makes an instructor of a visitor."""
AS_INSTRUCTOR = f"role=instructor&instructor_token={INSTRUCTOR}"
STEP = 5  # rows at a time: 200 Hz is what a shared machine keeps up with
READY, RUNNING, PAUSED, STOPPED, OVER = range(5)
PAGE = CONSOLES.index("page")


class FakeSession:
    """Rings, a socket pair, a thread that writes rows, and the page in a spawned process."""

    def __init__(self, header=HEADER, arms=("gold", "green"), folder=None, **options):
        options = {"instructor_token": INSTRUCTOR} | options
        self.layout = FrameLayout.of(arms)
        self.frames, self.events = (
            Ring.create(4096, 4 * self.layout.size),
            Ring.create(1024, EVENT_BYTES),
        )
        self._said, self._next = Ring.create(256, COMMAND_BYTES), 0
        self._port_told, port_taken = multiprocessing.Pipe()
        self.frame = Frame(self.layout)
        self.commands, self.port, self.tick = [], 0, 0
        self.folder = folder
        self._robot = _Robot(arms)
        self._moves, self._pedal, self._heard = {}, False, 0.0
        self._hazard, self._struck = -1, None
        self.frame["phase"], self.frame["runlevel"], self.frame["plc_runlevel"] = READY, 2, 2
        self.frame["cue_on"], self.frame["hazard"], self.frame["target"] = 1, -1, 0
        self.frame["link"] = 1
        self._stop = threading.Event()
        context = multiprocessing.get_context("spawn")
        listening = socket.create_server((options.get("host", "127.0.0.1"), 0))
        self.listens_at = listening.getsockname()[1]
        self.options = page.PageOptions(
            self.frames.name,
            self.events.name,
            self._said.name,
            tuple(arms),
            dict(header),
            folder and str(folder),
            **options,
        )
        self.process = context.Process(
            target=page.run_when_told, args=(port_taken, listening), daemon=True
        )
        self.process.start()
        port_taken.close()
        listening.close()
        self._port_told.send(self.options)
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def wait(self):
        """Until the page listens; its port."""
        waiting.until(lambda: self.port or not self.process.is_alive())
        assert self.port, "the page did not come up"
        return self.port

    def heard(self, **parts):
        """The first command so far, or soon, that has these parts."""

        def found():
            return next((one for one in [*self.commands] if parts.items() <= one.items()), None)

        return waiting.until(found, f"no command with {parts}")

    def event(self, kind, **more):
        put_json(self.events, {"tick": self.tick, "kind": kind, **more})

    def close(self):
        self._stop.set()
        self._thread.join()
        self.process.terminate()
        self.process.join(waiting.DEADLINE_S)
        alive = self.process.is_alive()
        if alive:
            self.process.kill()
        self._port_told.close()
        self.frames.close()
        self.events.close()
        self._said.close()
        assert not alive, "the page outlives its end"

    def _work(self):
        due = time.monotonic()
        while not self._stop.is_set():
            self._take()
            for _ in range(STEP):
                self._step()
            due = max(due + STEP / 1000, time.monotonic() - 0.05)
            time.sleep(max(0.0, due - time.monotonic()))

    def _take(self):
        if not self.port and self._port_told.poll():
            self.port = self._port_told.recv()
        first, rows = self._said.read(self._next)
        self._next = first + len(rows)
        for told in read_json(rows):
            self.commands.append(told)
            if told["type"] == "input":
                self._moves, self._heard = told["arms"], time.monotonic()
                self._set_pedal(told["pedal"])
            elif told["type"] == "seat":
                self._set_pedal(False)
            elif told["do"] == "estop":
                self._set("phase", STOPPED), self._set("runlevel", 0)
            elif told["do"] == "restart":
                self._set("phase", READY), self._set("runlevel", 2)
            elif told["do"] == "rehearse":
                self._set("view", 1)
            elif told["do"] in ("reengage", "discard"):
                self._set("view", 2 if told["do"] == "reengage" else 0)
            elif told["do"] == "arm":
                self._hazard, self._struck = told["hazard"], self.tick + 200
                self.event("hazard_armed", number=self._hazard, row={"cue": "on"})
            elif told["do"] in ("pause", "resume"):
                self._set("phase", PAUSED if told["do"] == "pause" else RUNNING)
            elif told["do"] == "cue":
                self.frame["cue_on"] = told["on"]
            elif told["do"] == "end":
                if self.folder:
                    (self.folder / "debrief.html").write_text(
                        "<!doctype html><h1>Debrief of the fake session</h1>"
                    )
                self._set("phase", OVER)
                self.event("end", reason="instructor")

    def _set(self, name, value):
        self.frame[name] = value
        words = {"phase": PHASES, "view": VIEWS}.get(name)
        self.event(name, **{name: words[value] if words else value})

    def _set_pedal(self, down):
        if down != self._pedal:
            self._pedal = down
            self.event("pedal", down=down)
            if self.frame.number("phase") in (READY, RUNNING):
                self._set("phase", RUNNING), self._set("runlevel", 3 if down else 2)
            if not down and self._struck is not None and self.tick > self._struck:
                self.event("response", number=self._hazard, what="release", ok=True, ms=self.tick)
                self.event("hazard_over", number=self._hazard, outcome="avoided")
                self._hazard, self._struck = -1, None

    def _step(self):
        frame, robot = self.frame, self._robot
        if frame.number("phase") != PAUSED:
            self.tick += 1
        alive = time.monotonic() - self._heard < 0.25
        pedal = self._pedal and alive and frame.number("runlevel") == 3
        struck = self._struck is not None and self.tick >= self._struck
        if struck and self.tick == self._struck:
            self.event("hazard_struck", number=self._hazard)
            self.event("cue", number=self._hazard, arm=robot.arms[0])
            self.event("alarm", check="dac_limit")
        for arm in robot.arms:
            if pedal and arm in self._moves:
                robot.move(arm, self._moves[arm])
            offset = (
                min(0.00004 * (self.tick - self._struck), 0.006)
                if struck and arm == robot.arms[0]
                else 0.0
            )
            robot.write(frame, arm, offset)
        frame["tick"] = frame["session_tick"] = self.tick
        frame["live"] = frame.number("runlevel") == 3
        frame["pedal"], frame["console_alive"], frame["surgeon_mode"] = self._pedal, alive, pedal
        frame["fault_active"], frame["hazard"] = struck, self._hazard
        frame["compute_us"] = 62 + 6 * np.sin(self.tick / 50)
        frame["lateness_us"] = 9 + 4 * np.cos(self.tick / 70)
        self.frames.put(frame.row.view(np.uint8))


class _Robot:
    def __init__(self, arms):
        self.arms = tuple(arms)
        self._model = arm_model.operating_scene()
        self._data = mujoco.MjData(self._model)
        self._jpos = {arm: np.array([0.5236, 1.5708, 0.4, 0, 0, 0.7854, 0.7854]) for arm in arms}
        self._written = dict.fromkeys(arms, ())

    def move(self, arm, hand):
        """A millisecond of the hand's speeds."""
        right, up, toward = hand.get("move", (0, 0, 0))
        side = 1 if arm == "gold" else -1
        self._jpos[arm][:3] += 1e-3 * np.array([side * 0.3 * right, 0.3 * toward, -0.05 * up])
        self._jpos[arm][5:] -= 1e-3 * hand.get("grasp", 0.0)

    def write(self, frame, arm, offset):
        jpos = self._jpos[arm]
        if self._written[arm] == (key := (offset, *jpos)):
            return  # it stands where the frame has it
        self._written[arm] = key
        wrong = jpos + np.array([15 * offset, 0, 0, 0, 0, 0, 0])
        tips = []
        for one in (wrong, jpos):
            self._data.qpos[
                [int(self._model.joint(name).qposadr[0]) for name in arm_model.joint_names(arm)]
            ] = one
            mujoco.mj_kinematics(self._model, self._data)
            base = self._model.body(arm_model.base_body(arm)).id
            turn = self._data.xmat[base].reshape(3, 3)
            tips.append(turn.T @ (self._data.site(f"{arm}_tip").xpos - self._data.xpos[base]))
        for name in ("jpos", "jpos_d", "link_jpos", "virtual_jpos"):
            frame[f"{arm}/{name}"] = wrong
        frame[f"{arm}/model_jpos"] = jpos
        frame[f"{arm}/tip"] = frame[f"{arm}/position"] = frame[f"{arm}/virtual_tip"] = tips[0]
        frame[f"{arm}/model_tip"] = tips[1]
        apart = tips[1] - tips[0]
        error = float(np.linalg.norm(apart))
        frame[f"{arm}/error_mm"] = frame[f"{arm}/unintended_mm"] = frame[f"{arm}/known_mm"] = (
            1e3 * error
        )
        frame[f"{arm}/force"] = min(0.05, 4.5 * error) * apart / error if error > 0.003 else 0.0
        frame[f"{arm}/depth_mm"] = -8.0
