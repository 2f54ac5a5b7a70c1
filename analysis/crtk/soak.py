"""Drives a robot over CRTK, and measures the rate, age and loss of its messages.

The script runs in the process that drives the robot, with the Python interpreter that has the ROS
packages. It therefore imports nothing of ravenjax.
"""

import itertools
import time

TOLD = (
    *("measured_js", "setpoint_js", "measured_cp", "setpoint_cp"),
    *("measured_cv", "operating_state", "cue_cf"),
)


def ask(questions, seconds):
    """Rate, age and loss of what is told while this peer drives for so long.

    All readings of one moment have one stamp: a stamp that came on one topic and not on another
    was lost there.
    """
    seconds = float(seconds)
    while any(questions.get(word) is None for word in TOLD):
        time.sleep(0.005)
    questions.enable()
    readings = ["arm1/" + word for word in TOLD if word != "operating_state"]
    came = {name: {} for name in readings}
    states, silences, sent = len(questions.states), 0, 0

    def hear(topic, message):
        questions._hear(topic, message)
        if topic in came:
            came[topic][questions.peer.stamp(message)] = time.time()

    questions.peer.heard = hear
    began, busy = time.time(), time.process_time()
    while time.time() - began < seconds:
        questions.peer.send("arm1/servo_jr", position=[0.0] * 7)
        sent += 1
        if questions.state() == "PAUSED":
            silences += 1
            questions.command("resume", "ENABLED", 2.0)
        time.sleep(0.005)
    questions.peer.heard = questions._hear
    busy = time.process_time() - busy
    stamps = sorted(set().union(*came.values()))[5:-5]  # the first and last may have come in part
    ages = sorted(
        1e3 * (one[stamp] - stamp) for one in came.values() for stamp in stamps if stamp in one
    )
    gaps = sorted(1e3 * (b - a) for a, b in itertools.pairwise(stamps))

    def quantiles(values):
        shares = (0.5, 0.99, 0.999, 1)
        return [round(values[int(share * (len(values) - 1))], 2) for share in shares]

    return {
        "seconds": seconds,
        "moments": len(stamps),
        "rate_hz": round((len(stamps) - 1) / (stamps[-1] - stamps[0]), 2),
        "lost": {name: sum(stamp not in one for stamp in stamps) for name, one in came.items()},
        "age_ms": quantiles(ages),
        "gap_ms": quantiles(gaps),
        "commands": sent,
        "paused": silences,
        "states": sorted(set(questions.states[states:])),
        "peer_cpu_s": round(busy, 1),
    }
