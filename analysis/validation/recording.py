"""Measures the distance of the virtual robot from a recorded robot, and prints tables.

    python analysis/validation/recording.py [FOLDER]

FOLDER holds recording_gold_joints123.parquet: 21 s of a real gold arm in pedal-down teleoperation,
motors of shoulder, elbow and insertion at 1 kHz (public repository CSLDepend/raven2_sim). The
default is $RAVENJAX_DATA, then ../shared/data beside the repository. There are three comparisons:

1. The authors' own model, re-initialised from the recording every 1 and 20 ms and never (their
published behaviour).

2. The virtual robot under the recorded DAC, re-initialised in the same way.

3. The virtual robot in closed loop under the control software's PD law with the 2015 fork's
estimator. The file lacks the desired motion, but the PD law can be inverted: mpos_d = mpos + (tau +
KD mvel) / KP. The arm is driven by this desired motion. For comparison with an earlier rebuild, it
is also driven by the recording itself through a 20 Hz low-pass.
"""

import math
import os
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import butter, filtfilt

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import kinematics, transmission
from ravenjax.robots.raven2.plant import robot

sys.path.insert(0, str(Path(__file__).parents[1]))

from studies.dsn16 import recording
from studies.dsn16.recording import (
    ARM,
    FILE,
    JOINTS,
    SETUP,
    TOOL,
    TOOL_POSE,
    closed_loop,
    motors,
    started,
)
from validation import authors


def tips(mpos: np.ndarray) -> np.ndarray:
    """Return the tip (m) of forward-coupled motor angles, with ideal tool joints."""

    def tip(three):
        jpos = transmission.joint_from_motor(ARM, TOOL, motors(three), "fork2015")
        return jnp.stack(kinematics.forward_pose(ARM, Vec((*jpos[:3], *TOOL_POSE))).position)

    return np.asarray(jax.jit(jax.vmap(tip))(jnp.asarray(mpos)))


def windows(values: np.ndarray, length: int) -> np.ndarray:
    """Return windows [W, length, 3]."""
    count = len(values) // length
    return values[: count * length].reshape(count, length, 3)


def rms(error: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(error.reshape(-1, error.shape[-1]) ** 2, axis=0))


def authors_windows(angle, speed, dac, length: int) -> tuple[np.ndarray, np.ndarray]:
    """Return rms errors of motor angle (rad) and speed (rad/s) of the authors' Euler model,
    re-initialised every `length` ms.
    """

    def window(start_angle, start_speed, counts):
        state = authors.initial(Vec(start_angle), Vec(start_speed))

        def tick(state, row):
            state = authors.euler(state, Vec(row), tension_bug=True)
            return state, (jnp.stack(state.m), jnp.stack(state.md))

        return jax.lax.scan(tick, state, counts)[1]

    return compare(window, angle, speed, dac, length)


def robot_windows(angle, speed, dac, length: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of the virtual robot, started in the same way: links from the motors,
    cables carrying gravity.
    """
    params = robot.params(SETUP, ARM)

    def window(start_angle, start_speed, counts):
        state = started(params, start_angle, start_speed)

        def tick(state, row):
            command = Vec((*(row[i].astype(jnp.int32) for i in range(3)), *(jnp.int32(0),) * 4))
            state, out = robot.step(
                SETUP, ARM, params, state, robot.PlantSignal(command, jnp.int32(0))
            )
            return state, (jnp.stack(out.mpos[:3]), jnp.stack(out.mvel[:3]))

        return jax.lax.scan(tick, state, counts)[1]

    return compare(window, angle, speed, dac, length)


def compare(window, angle, speed, dac, length: int) -> tuple[np.ndarray, np.ndarray]:
    # A state at row k is moved to row k + 1 by the DAC of row k.
    starts, ends = windows(angle[:-1], length)[:, 0], windows(angle[1:], length)
    found_angle, found_speed = jax.jit(jax.vmap(window))(
        starts, windows(speed[:-1], length)[:, 0], windows(dac[:-1], length)
    )
    return rms(np.asarray(found_angle) - ends), rms(
        np.asarray(found_speed) - windows(speed[1:], length)
    )


def row(label: str, *groups: np.ndarray) -> None:
    print(f"{label:34s}" + "   ".join(" ".join(f"{x:9.4g}" for x in group) for group in groups))


def report_closed_loop(label: str, asked, angle, speed, dac, parameter_set: str = "traj3") -> None:
    found = closed_loop(asked, angle[0], speed[0], parameter_set)
    settle = 200  # ms left out, because the initial cable stretch is unknown
    mpos = found["mpos"][settle:, :3]
    row(f"{label}: motor rms", rms(mpos - angle[settle:]))
    ratio = np.array(transmission.TR[:3])
    row(
        "    the same at the joint (deg, mm)",
        rms(mpos - angle[settle:]) / ratio * (180 / math.pi, 180 / math.pi, 1e3),
    )
    distance = np.linalg.norm(tips(mpos) - tips(angle[settle:]), axis=1) * 1e3
    row(
        "    tip mean, 99 %, max (mm)",
        np.array([distance.mean(), np.quantile(distance, 0.99), distance.max()]),
    )
    counts = found["dac"][settle:, :3]
    row("    DAC std of robot, of recording", counts.std(axis=0), dac[settle:].std(axis=0))
    correlation = [np.corrcoef(counts[:, i], dac[settle:, i])[0, 1] for i in range(3)]
    row("    DAC correlation; rms difference", np.array(correlation), rms(counts - dac[settle:]))
    row("    motor speed rms difference", rms(found["mvel"][settle:, :3] - speed[settle:]))


def main() -> None:
    default = Path(
        os.environ.get("RAVENJAX_DATA", Path(__file__).resolve().parents[3] / "shared" / "data")
    )
    path = (Path(sys.argv[1]) if len(sys.argv) > 1 else default) / FILE
    if not path.is_file():
        sys.exit(f"{path} is absent; give the folder that holds it as argument or in RAVENJAX_DATA")
    found = recording.read(path)
    angle, speed, dac = found
    with jax.enable_x64(True):
        print(f"{'':34s}motor rms (rad) of {', '.join(JOINTS)}; speed rms (rad/s)")
        for length in (1, 20, len(dac) - 1):
            every = "never" if length > 20 else f"every {length} ms"
            row(f"authors' model, reset {every}", *authors_windows(angle, speed, dac, length))
        for length in (1, 20, len(dac) - 1):
            every = "never" if length > 20 else f"every {length} ms"
            row(f"virtual robot, reset {every}", *robot_windows(angle, speed, dac, length))
        hold = np.diff(angle, axis=0) - speed[:-1] * 1e-3, np.diff(speed, axis=0)
        row("speed held, reset every 1 ms", *(rms(x) for x in hold))
        print("\nclosed loop; desired motor angles recovered from the recorded torque")
        for name in ("traj3", "E", "B", "matlab_global"):
            report_closed_loop(f"set {name}", found.asked, angle, speed, dac, name)
        print(
            "\nclosed loop; asked for the recording itself, low-passed at 20 Hz (both ways, no delay)"  # noqa: E501
        )
        low_passed = filtfilt(*butter(2, 20, fs=1000), angle, axis=0)
        report_closed_loop("set traj3", low_passed, angle, speed, dac)
        print(
            "a three-joint rebuild: motor rms 0.385 0.548 0.631 rad, tip mean 0.41, max 1.08 mm, DAC std 228 328 198"  # noqa: E501
        )


if __name__ == "__main__":
    main()
