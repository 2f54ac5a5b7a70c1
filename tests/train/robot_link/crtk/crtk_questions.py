"""What is asked of a robot that says it speaks CRTK, over any transport: one answer in numbers for
each question.

Only the conventions are known here, not the robot's code; it runs in any Python, that of ROS 1 too.
The questions about frame, scale and rate are those that a public suite for CRTK over ROS 1 asks;
the rest is ours.

A peer has `last(topic)` (a message or None), `count(topic)`, `send(topic, **fields)`,
`stamp(message)` in s, `arrived(topic)` in s since 1970, and calls `heard(topic, message)` for each
message once that is set.

A robot takes a console for dead that is silent for a quarter of a second, as it should. A busy
machine may keep this program, or the robot, waiting for so long: then the question is asked again,
see `Questions.asked`.
"""

import json
import math
import runpy
import threading
import time

ARM = "arm1"
TOLD = [
    *("measured_js", "setpoint_js", "measured_cp", "setpoint_cp", "measured_cv", "cue_cf"),
    "operating_state",
]


HELD_UP = 0.1  # s without a word of the robot, or without a moment for this program
MORE = 40.0  # s for all questions that are asked again


def topics(joints, pose, twist, wrench, state, text, joy):
    """The classes of what an arm tells, by word, and of what it is told, by topic."""
    kinds = {"measured_js": joints, "setpoint_js": joints, "operating_state": state}
    kinds |= {"measured_cp": pose, "setpoint_cp": pose, "measured_cv": twist}
    kinds |= {"cue_cf": wrench, "measured_cf": wrench}
    commands = {"arm1/state_command": text, "arm1/servo_cp": pose}
    commands |= dict.fromkeys(("arm1/servo_jp", "arm1/servo_jr", "arm1/move_jp"), joints)
    return kinds, commands | dict.fromkeys(("console/operator_present", "console/clutch"), joy)


def until(true, seconds=20.0):
    end = time.time() + seconds
    while time.time() < end:
        if true():
            return True
        time.sleep(0.005)
    return False


class Questions:
    def __init__(self, peer):
        self.peer = peer
        self.held = None  # the servo command that is repeated while answers are awaited
        self.states = []  # that were told
        self.held_up = 0  # how often somebody was kept waiting
        self.end = None  # no question is asked again after it
        self._last = None
        peer.heard = self._hear
        threading.Thread(target=self._watch, daemon=True).start()

    def _hear(self, topic, message):
        if topic == ARM + "/operating_state":
            self.states.append(message.state)
        elif topic == ARM + "/measured_js":
            stamp = self.peer.stamp(message)
            self.held_up += self._last is not None and stamp - self._last > HELD_UP
            self._last = stamp

    def _watch(self):
        before = time.time()
        while True:
            time.sleep(0.01)
            now = time.time()
            self.held_up += now - before > HELD_UP
            before = now

    def get(self, word):
        return self.peer.last(ARM + "/" + word)

    def fresh(self, word):
        """A message of something that is measured from now on."""
        name, before = ARM + "/" + word, self.peer.count(ARM + "/" + word)

        def heard():
            if self.held is not None:
                self.peer.send(ARM + "/" + self.held[0], **self.held[1])
            return self.peer.count(name) > before + 2

        assert until(heard), "nothing new of " + name
        return self.peer.last(name)

    def state(self):
        return self.get("operating_state").state

    def command(self, word, expected, seconds=20.0):
        self.peer.send(ARM + "/state_command", string=word)
        return until(lambda: self.state() == expected, seconds)

    def ready(self):
        """Enabled; a robot that heard nothing for a while is paused, as it should be."""
        until(lambda: self.state() != "FAULT")  # it was not heard of for a moment
        if self.state() == "PAUSED":
            self.command("resume", "ENABLED")
        assert self.state() == "ENABLED", self.state()
        self.held = None

    def stream(self, word, message, seconds):
        """Send the same again and again, so that nobody takes this peer for dead."""
        self.held = (word, message)
        end = time.time() + seconds
        while time.time() < end:
            self.peer.send(ARM + "/" + word, **message)
            time.sleep(0.01)

    def joints(self, word="setpoint_js"):
        return list(self.fresh(word).position)

    def place(self, word="setpoint_cp"):
        pose = self.fresh(word).pose
        p, q = pose.position, pose.orientation
        return [p.x, p.y, p.z], [q.x, q.y, q.z, q.w]

    def reading(self):
        """Names, frames, units, rate and stamps of what is told."""
        assert until(lambda: all(self.get(word) is not None for word in TOLD), 60.0), (
            "not everything is told"
        )
        name, ages, stamps = ARM + "/measured_js", [], []
        while len(stamps) < 200:
            message, arrived = self.peer.last(name), self.peer.arrived(name)
            stamp = self.peer.stamp(message)
            if message is self.peer.last(name) and stamp not in stamps[-1:]:
                stamps.append(stamp)
                ages.append(arrived - stamp)
            time.sleep(0.002)
        js, cp = self.fresh("measured_js"), self.fresh("measured_cp")
        q = cp.pose.orientation
        return {
            "names": list(js.name),
            "frames": [js.header.frame_id, cp.header.frame_id],
            "rate": (len(stamps) - 1) / (stamps[-1] - stamps[0]),
            "age": sorted(ages)[len(ages) // 2],
            "joints": list(js.position),
            "position": [cp.pose.position.x, cp.pose.position.y, cp.pose.position.z],
            "quat": [q.x, q.y, q.z, q.w],
            "velocities": len(js.velocity),
            "state": self.state(),
            "homed": bool(self.get("operating_state").is_homed),
        }

    def frame(self):
        """Displacements of the setpoint for 4 mm along each axis of the frame that poses are told
        in, and how far the measured tip is from there.
        """
        moved = []
        self.held = None
        for axis in range(3):
            start, quat = self.place()
            self.ready()
            goal = list(start)
            goal[axis] += 0.004
            self.stream("servo_cp", {"position": goal, "quat": quat}, 1.0)
            reached, measured = self.place()[0], self.place("measured_cp")[0]
            off = math.sqrt(sum((a - b) ** 2 for a, b in zip(measured, reached, strict=True)))
            moved.append(([a - b for a, b in zip(reached, start, strict=True)], off))
        return moved

    def scale(self):
        """Joints: what ten relative steps and an absolute setpoint come to."""
        start = self.joints()
        self.ready()
        for _ in range(10):
            self.peer.send(ARM + "/servo_jr", position=[0.004, 0, 0.0005, 0, 0, 0, 0])
            time.sleep(0.03)
        self.stream("servo_jr", {"position": [0.0] * 7}, 0.5)
        relative = [a - b for a, b in zip(self.joints(), start, strict=True)]
        self.ready()
        self.stream("servo_jp", {"position": start}, 1.0)
        return {
            "relative": relative,
            "back": [a - b for a, b in zip(self.joints(), start, strict=True)],
        }

    def move(self):
        """move_jp: busy on the way, there at the end."""
        start = self.joints()
        goal = list(start)
        goal[0] += 0.1
        goal[2] += 0.01
        self.ready()
        self.held = None
        began = time.time()
        self.peer.send(ARM + "/move_jp", position=goal)
        busy = until(lambda: self.get("operating_state").is_busy)
        done = until(lambda: not self.get("operating_state").is_busy)
        seconds = time.time() - began
        time.sleep(0.3)
        off = [a - b for a, b in zip(self.joints(), goal, strict=True)]
        return {"busy": busy, "done": done, "seconds": seconds, "off": off, "state": self.state()}

    def feet(self):
        """Who steps off is paused, and the clutch lets go without a word."""
        peer = self.peer
        result = [self.command("pause", "PAUSED")]
        for topic, button, state in (
            ("operator_present", 0, "PAUSED"),
            ("operator_present", 1, "ENABLED"),
            ("clutch", 1, "PAUSED"),
            ("clutch", 0, "ENABLED"),
            ("operator_present", 0, "PAUSED"),
        ):
            time.sleep(0.1)
            peer.send("console/" + topic, buttons=[button])
            result.append(until(lambda state=state: self.state() == state))
        return result

    def asked(self, word, moves=False):
        """The answer of a question; asked again where somebody was kept waiting meanwhile.

        moves: also where the robot was not enabled all the time.
        """
        self.end = self.end or time.time() + MORE
        while True:
            if moves:
                self.ready()
            held_up, told = self.held_up, len(self.states)
            answer = getattr(self, word)()
            paused = moves and set(self.states[told:]) - {"ENABLED"}
            if (self.held_up == held_up and not paused) or time.time() > self.end:
                return answer

    def all(self):
        answers = {"reading": self.asked("reading")}
        assert self.command("enable", "ENABLED"), self.state()
        answers |= {word: self.asked(word, moves=True) for word in ("frame", "scale", "move")}
        answers["feet"] = self.asked("feet")
        # The last two leave the robot where it begins.
        return answers | {
            word: self.command(word, state)
            for word, state in (("disable", "DISABLED"), ("enable", "ENABLED"))
        }

    def enable(self):
        """Whatever the state is, as often as it takes."""
        words = {"DISABLED": "enable", "FAULT": "enable", "PAUSED": "resume"}

        def enabled():
            word = words.get(self.state())
            return word is None or self.command(word, "ENABLED", 2.0)

        assert until(enabled, 60.0), self.state()

    def hold(self):
        """Drive until somebody ends this program."""
        self.enable()
        print(json.dumps("drives"), flush=True)
        while True:
            self.stream("servo_jr", {"position": [1e-5, 0, 0, 0, 0, 0, 0]}, 0.2)
            self.enable()

    def visit(self):
        """Drive for a moment and fall silent; the end is when the pedal has come up."""
        self.enable()
        self.stream("servo_jr", {"position": [1e-5, 0, 0, 0, 0, 0, 0]}, 1.0)
        print(
            json.dumps("left" if until(lambda: self.state() == "PAUSED") else self.state()),
            flush=True,
        )


def main(peer, arguments):
    """Arguments: all | hold | visit, or a program whose `ask` gets the questions, and its own."""
    time.sleep(1.0)
    questions = Questions(peer)
    if arguments[0].endswith(".py"):
        print(
            json.dumps(runpy.run_path(arguments[0])["ask"](questions, *arguments[1:])), flush=True
        )
    elif arguments[0] in ("hold", "visit"):
        assert until(lambda: questions.get("operating_state") is not None, 60.0)
        getattr(questions, arguments[0])()
    else:
        print(json.dumps(questions.all()), flush=True)
