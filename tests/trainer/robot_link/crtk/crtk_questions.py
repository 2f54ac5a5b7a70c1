"""What is asked of a robot that says it speaks CRTK, over any transport: one answer in numbers for each question.

Only the conventions are known here, not the robot's code; it runs in any Python, that of ROS 1 too. The questions about
frame, scale, rate and precondition are those that a public suite for CRTK over ROS 1 asks; the rest is ours.

A peer has `last(topic)` (a message or None), `count(topic)`, `send(topic, **fields)`, `stamp(message)` in s.
"""

import itertools
import json
import math
import socket
import time

ARM = "arm1"
JOINTS = ["shoulder", "elbow", "insertion", "tool_roll", "wrist", "grasp1", "grasp2"]
TOLD = ["measured_js", "setpoint_js", "measured_cp", "setpoint_cp", "measured_cv", "operating_state", "cue_cf"]


def until(true, seconds=5.0):
    end = time.time() + seconds
    while time.time() < end:
        if true():
            return True
        time.sleep(0.005)
    return False


class Questions:
    def __init__(self, peer, joint_port):
        self.peer, self.port = peer, joint_port
        self.held = None  # the servo command that is repeated while answers are awaited

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

    def command(self, word, expected, seconds=5.0):
        self.peer.send(ARM + "/state_command", string=word)
        return until(lambda: self.state() == expected, seconds)

    def ready(self):
        """Enabled; a robot that heard nothing for a while is paused, as it should be."""
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
        assert until(lambda: all(self.get(word) is not None for word in TOLD), 20.0), "not everything is told"
        first, began = self.peer.count(ARM + "/measured_js"), time.time()
        time.sleep(3.0)
        rate = (self.peer.count(ARM + "/measured_js") - first) / (time.time() - began)
        js, cp = self.fresh("measured_js"), self.fresh("measured_cp")
        q = cp.pose.orientation
        return {
            "names": list(js.name),
            "frames": [js.header.frame_id, cp.header.frame_id],
            "rate": rate,
            "age": -self.peer.stamp(self.fresh("measured_js")) + self.peer.arrived(ARM + "/measured_js"),
            "joints": list(js.position),
            "position": [cp.pose.position.x, cp.pose.position.y, cp.pose.position.z],
            "quat": [q.x, q.y, q.z, q.w],
            "velocities": len(js.velocity),
            "state": self.state(),
            "homed": bool(self.get("operating_state").is_homed),
        }

    def precondition(self):
        """Whether motion is refused before the robot is enabled, and invalid commands change nothing."""
        before = self.joints()
        states = []
        for word in ("pause", "resume"):
            self.peer.send(ARM + "/state_command", string=word)
            time.sleep(0.1)
            states.append(self.state())
        self.stream("servo_jr", {"position": [0.01, 0, 0, 0, 0, 0, 0]}, 0.5)
        self.held = None
        return {"moved": max(abs(a - b) for a, b in zip(self.joints(), before, strict=True)), "states": states}

    def frame(self):
        """Displacements of setpoint and measurement for 4 mm along each axis of the frame that poses are told in."""
        moved = []
        self.held = None
        for axis in range(3):
            start, quat = self.place()
            self.ready()
            goal = list(start)
            goal[axis] += 0.004
            self.stream("servo_cp", {"position": goal, "quat": quat}, 1.0)
            reached = self.place()[0]
            measured = self.place("measured_cp")[0]
            moved.append(
                {
                    "setpoint": [a - b for a, b in zip(reached, start, strict=True)],
                    "off": math.sqrt(sum((a - b) ** 2 for a, b in zip(measured, reached, strict=True))),
                }
            )
            self.stream("servo_cp", {"position": start, "quat": quat}, 0.6)
        return moved

    def turn(self):
        """A turn of 0.1 rad about the frame's z: setpoint's quaternion times the inverse of the one before."""
        start, (x, y, z, w) = self.place()
        self.ready()
        s, c = math.sin(0.05), math.cos(0.05)
        goal = [c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z]
        self.stream("servo_cp", {"position": start, "quat": goal}, 1.0)
        a, b, d, e = self.place()[1]
        relative = [a * w - x * e - (b * z - d * y), b * w - y * e - (d * x - a * z), d * w - z * e - (a * y - b * x)]
        return {"axis_times_sine": relative, "sine": s}

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
        return {"relative": relative, "back": [a - b for a, b in zip(self.joints(), start, strict=True)]}

    def velocity(self):
        """measured_cv beside what measured_cp covers in its time, while the tip moves steadily."""
        start, quat = self.place()
        self.ready()
        marks, speeds, began = [], [], time.time()
        while time.time() - began < 1.6:
            t = time.time() - began
            self.peer.send(ARM + "/servo_cp", position=[start[0], start[1] + 0.005 * t, start[2]], quat=quat)
            if t > 0.5:
                cp, cv = self.get("measured_cp"), self.get("measured_cv")
                marks.append((self.peer.stamp(cp), cp.pose.position.y))
                speeds.append(cv.twist.linear.y)
            time.sleep(0.01)
        path = (marks[-1][1] - marks[0][1]) / (marks[-1][0] - marks[0][0])
        self.stream("servo_cp", {"position": start, "quat": quat}, 0.8)
        return {"by_position": path, "by_velocity": sum(speeds) / len(speeds)}

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
        busy = until(lambda: self.get("operating_state").is_busy, 1.0)
        done = until(lambda: not self.get("operating_state").is_busy, 10.0)
        seconds = time.time() - began
        time.sleep(0.3)
        off = [a - b for a, b in zip(self.joints(), goal, strict=True)]
        return {"busy": busy, "done": done, "seconds": seconds, "off": off, "state": self.state()}

    def refusals(self):
        """What no robot should follow: not finite, too far, beyond a limit, too few numbers."""
        before, (place, quat) = self.joints(), self.place()
        self.ready()
        self.stream("servo_cp", {"position": place, "quat": quat}, 0.3)
        before = self.joints()
        far = [place[0] + 0.5, place[1], place[2]]
        for message in (
            {"position": [float("nan")] * 3, "quat": quat},
            {"position": far, "quat": quat},
            {"position": place, "quat": [0.0] * 4},
        ):
            self.peer.send(ARM + "/servo_cp", **message)
        for position in ([9.0] + before[1:], before[:3], [float("inf")] + before[1:]):
            self.peer.send(ARM + "/servo_jp", position=position)
        time.sleep(0.2)
        return {"moved": max(abs(a - b) for a, b in zip(self.joints(), before, strict=True))}

    def clutch(self):
        """Feet on the pedals: who steps off is paused, and the clutch lets go without a word."""
        peer = self.peer
        result = {"paused": self.command("pause", "PAUSED")}
        peer.send("console/operator_present", buttons=[0])
        time.sleep(0.1)
        peer.send("console/operator_present", buttons=[1])
        result["present"] = until(lambda: self.state() == "ENABLED")
        peer.send("console/clutch", buttons=[1])
        result["clutched"] = until(lambda: self.state() == "PAUSED")
        before, (place, quat) = self.place()[0], self.place()
        self.stream("servo_cp", {"position": [place[0] + 0.003, place[1], place[2]], "quat": quat}, 0.4)
        self.held = None
        result["moved"] = max(abs(a - b) for a, b in zip(self.place()[0], before, strict=True))
        peer.send("console/clutch", buttons=[0])
        result["released"] = until(lambda: self.state() == "ENABLED")
        peer.send("console/operator_present", buttons=[0])
        result["left"] = until(lambda: self.state() == "PAUSED")
        return result

    def disabling(self):
        """Off, and on again."""
        self.held = None
        self.peer.send("console/operator_present", buttons=[0])
        result = {"disabled": self.command("disable", "DISABLED"), "homed": bool(self.get("operating_state").is_homed)}
        result["enabled"] = self.command("enable", "ENABLED")
        result["homed_again"] = bool(self.get("operating_state").is_homed)
        return result

    def estop(self):
        """Somebody presses the E-stop while a foot is on the pedal: nothing but an act of its own drives again."""
        peer = self.peer
        peer.send("console/operator_present", buttons=[1])
        time.sleep(0.2)
        with socket.create_connection(("127.0.0.1", self.port)) as stream:
            stream.sendall(json.dumps({"order": "estop"}).encode() + b"\n")
            result = {"fault": until(lambda: self.state() == "FAULT")}
            result["homed"] = bool(self.get("operating_state").is_homed)
        peer.send("console/operator_present", buttons=[1])  # the foot that never moved
        peer.send(ARM + "/state_command", string="resume")
        peer.send(ARM + "/servo_jr", position=[0.01, 0, 0, 0, 0, 0, 0])
        time.sleep(0.4)
        result["still"] = self.state()
        result["home"] = self.command("home", "PAUSED")
        peer.send("console/operator_present", buttons=[1])
        time.sleep(0.4)
        result["foot"] = self.state()
        peer.send("console/operator_present", buttons=[0])
        time.sleep(0.05)
        peer.send("console/operator_present", buttons=[1])
        result["enabled"] = until(lambda: self.state() == "ENABLED")
        return result

    def silence(self):
        """How long after the last servo command the pedal is up, s, and the force then."""
        if self.state() != "ENABLED":
            self.command("resume", "ENABLED")
        self.stream("servo_jr", {"position": [0.0] * 7}, 0.5)
        self.held = None
        began = time.time()
        paused = until(lambda: self.state() == "PAUSED", 3.0)
        seconds = time.time() - began
        force = self.fresh("cue_cf").wrench.force
        return {"paused": paused, "seconds": seconds, "force": [force.x, force.y, force.z]}

    def moving(self, word):
        """The answer of a question that moves the robot; asked again where this machine kept the peer waiting so long
        that the robot took it for dead."""
        for _ in range(4):
            answer = getattr(self, word)()
            if self.state() == "ENABLED":
                break
            time.sleep(1.0)
        return answer

    def all(self):
        answers = {word: getattr(self, word)() for word in ("reading", "precondition")}
        assert self.command("enable", "ENABLED"), self.state()
        answers |= {word: self.moving(word) for word in ("frame", "turn", "scale", "velocity", "move", "refusals")}
        return answers | {word: getattr(self, word)() for word in ("clutch", "disabling", "estop", "silence")}

    def hold(self):
        """Drive until somebody ends this program."""
        for word in ("enable", "resume") * 4:
            if self.command(word, "ENABLED", 1.0):
                break
        print(json.dumps("drives" if self.state() == "ENABLED" else self.state()), flush=True)
        while True:
            self.stream("servo_jr", {"position": [1e-5, 0, 0, 0, 0, 0, 0]}, 1.0)

    def soak(self, seconds):
        """Rate, age and gaps of measured_js while this peer reads for so long, and drives."""
        name, peer = ARM + "/measured_js", self.peer
        assert until(lambda: self.get("measured_js") is not None and self.get("operating_state") is not None, 20.0)
        assert self.command("enable" if self.state() == "DISABLED" else "resume", "ENABLED", 10.0)
        began, at, first = time.time(), peer.count(name), self.fresh("measured_js")
        stamps, ages = [], []
        while time.time() - began < seconds:
            peer.send(ARM + "/servo_jr", position=[0.0] * 7)
            time.sleep(0.001)
            message = peer.last(name)
            stamp = peer.stamp(message)
            if not stamps or stamp != stamps[-1]:
                stamps.append(stamp)
                ages.append(peer.arrived(name) - stamp)
            time.sleep(0.003)
        ages.sort()
        gaps = sorted(b - a for a, b in itertools.pairwise(stamps))
        some = lambda values, share: values[min(int(share * len(values)), len(values) - 1)]  # noqa: E731
        return {
            "messages": peer.count(name) - at,
            "seconds": time.time() - began,
            "rate": (peer.count(name) - at) / (time.time() - began),
            "age_ms": [1e3 * some(ages, share) for share in (0.5, 0.99, 0.999, 1.0)],
            "gap_ms": [1e3 * some(gaps, share) for share in (0.5, 0.99, 0.999, 1.0)],
            "state": self.state(),
            "first": peer.stamp(first),
        }


def main(peer, arguments):
    """Arguments: all | hold | soak, the robot's joint port, s of a soak."""
    time.sleep(1.0)
    questions = Questions(peer, int(arguments[1]))
    if arguments[0] == "soak":
        print(json.dumps(questions.soak(float(arguments[2]))), flush=True)
    elif arguments[0] == "hold":
        assert until(lambda: questions.get("operating_state") is not None, 20.0)
        questions.hold()
    else:
        print(json.dumps(questions.all()), flush=True)
