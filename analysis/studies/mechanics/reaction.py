"""How much of the links' load a recorded motor carries: the gearbox ratio, as statics say, or 1, as
published?

    k DAC = J m'' + rho l(q, q', q'') + b m' + c sgn(m') + offset        a motor's torque after the gearbox

is linear in J, rho, b, c and the offset; the load l of the rigid links is that of the published
masses, in motor coordinates. Angles are smoothed for their derivatives, and rows at rest left out,
where dry friction may be anything.
"""  # noqa: E501

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.dynamics import link_dynamics
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant.coupling import N, coupling
from ravenjax.stats.bootstrap.resample import bootstrap
from studies.dsn16.recording.closed_loop import ARM, SETUP, TOOL, JointRecording, motors

WINDOW_MS, ORDER = 41, 3  # of the Savitzky-Golay filter
MOVING_RAD_S = 1.0
STRETCHES = 20
"""Pieces of the recording, about a second each, over which the bootstrap goes."""


class LoadShare(NamedTuple):
    """One joint: estimates with their 95 % bands over stretches of the recording."""

    inertia: tuple[float, float, float]  # J, kg m2 in the equation's units: value, low, high
    scale: tuple[float, float, float]  # rho, 1
    torque_share: float  # standard deviation of the load's part of the torque by that of the torque


class TorqueError(NamedTuple):
    """Absolute errors of a motor's torque on the second half of a recording, fitted to the
    first; N m, [3] each.
    """

    model: str
    mean: np.ndarray
    largest: np.ndarray


class _Joint(NamedTuple):
    """Rows in which one joint moves."""

    columns: np.ndarray  # [n, 5] acceleration, load, speed, direction, 1
    torque: np.ndarray  # [n] N m
    place: np.ndarray  # [n] place in the recording, 0 to 1


MODELS: dict[str, tuple[tuple[int, ...], float]] = {
    "null: the first half's mean torque": ((4,), 0.0),
    "null: bare rotor, viscous friction": ((0, 2), 0.0),
    "rotor with dry friction and offset": ((0, 2, 3, 4), 0.0),
    "the same and the load, once (authors)": ((0, 2, 3, 4), 1.0),
    "the same and the load, 12.25 times (statics)": ((0, 2, 3, 4), transmission.GP42),
    "the same and the load, fitted": ((0, 1, 2, 3, 4), 0.0),
}
"""Columns that are fitted, and how many times the load is taken as given."""
COMPARED = tuple(MODELS)[2:5]
"""Without the load, as the authors have it, and as statics have it."""


def of_recording(log: JointRecording) -> list[LoadShare]:
    """Of shoulder, elbow and insertion; needs 64 bits."""
    return [
        _fit(joint.columns, joint.torque, (joint.place * STRETCHES).astype(int))
        for joint in _moving(log)
    ]


def held_out(log: JointRecording) -> list[TorqueError]:
    """How well each of MODELS, fitted to the first half, predicts the torque of the second;
    needs 64 bits.
    """
    joints = _moving(log)
    errors = []
    for model, (fitted, load) in MODELS.items():
        apart = [
            np.abs(_predicted(joint, fitted, load) - joint.torque[joint.place >= 0.5])
            for joint in joints
        ]
        mean, largest = (
            np.array([statistic(one) for one in apart]) for statistic in (np.mean, np.max)
        )
        errors.append(TorqueError(model, mean, largest))
    return errors


def _predicted(joint: _Joint, fitted: tuple[int, ...], load: float) -> np.ndarray:
    """Torque of the second half."""
    first, columns, fixed = joint.place < 0.5, joint.columns[:, fitted], load * joint.columns[:, 1]
    best, *_ = np.linalg.lstsq(columns[first], (joint.torque - fixed)[first], rcond=None)
    return columns[~first] @ best + fixed[~first]


def _moving(log: JointRecording) -> list[_Joint]:
    from scipy.signal import savgol_filter

    angle, speed, acceleration = (
        np.asarray(savgol_filter(log.angle, WINDOW_MS, ORDER, deriv=d, delta=1e-3, axis=0))
        for d in range(3)
    )
    torque = -np.asarray(savgol_filter(log.dac, WINDOW_MS, ORDER, axis=0)) / np.array(
        transmission.COUNTS_PER_NM[:3]
    )
    load = np.asarray(jax.jit(jax.vmap(_load))(*map(jnp.asarray, (angle, speed, acceleration))))
    inside = np.zeros(len(angle), bool)
    inside[WINDOW_MS:-WINDOW_MS] = True
    joints = []
    for j in range(3):
        rows = inside & (np.abs(speed[:, j]) > MOVING_RAD_S)
        columns = (
            acceleration[:, j],
            load[:, j],
            speed[:, j],
            np.sign(speed[:, j]),
            np.ones(len(angle)),
        )
        joints.append(
            _Joint(
                np.stack(columns, axis=1)[rows], torque[rows, j], np.flatnonzero(rows) / len(rows)
            )
        )
    return joints


def _load(angle: Any, speed: Any, acceleration: Any) -> jax.Array:
    """Torque (N m, motor coordinates) that rigid links ask of motors 1-3, cables unstretched;
    [3] each.
    """

    def joints(three: Any, still: bool) -> Vec:
        return transmission.joint_from_motor(ARM, TOOL, motors(three, still=still), SETUP.software)

    jpos, jvel, jacc = joints(angle, False), joints(speed, True), joints(acceleration, True)
    gravity = Vec((-9.81, 0.0, 0.0))
    mass, bias = link_dynamics.mass_matrix_and_bias(SETUP, ARM, jpos, jvel, gravity, 1.0)
    force = Vec(
        sum(mass[max(i, j)][min(i, j)] * jacc[j] for j in range(N)) + bias[i] for i in range(N)
    )
    return jnp.stack(coupling(ARM, TOOL, SETUP.software).carried(force)[:3])


def _fit(columns: np.ndarray, torque: np.ndarray, stretch: np.ndarray) -> LoadShare:
    """Least squares, and the same over resampled stretches."""
    pieces = [stretch == s for s in np.unique(stretch)]
    squares = np.array([columns[p].T @ columns[p] for p in pieces])
    products = np.array([columns[p].T @ torque[p] for p in pieces])

    def solved(rows: np.ndarray) -> np.ndarray:
        return np.linalg.solve(squares[rows].sum(axis=1), products[rows].sum(axis=1)[..., None])[
            ..., 0
        ]

    best = solved(np.arange(len(pieces))[None])[0]
    bands = [bootstrap(len(pieces), lambda rows, k=k: solved(rows)[:, k]) for k in (0, 1)]
    inertia, scale = (
        (float(best[k]), float(band.low), float(band.high)) for k, band in enumerate(bands)
    )
    return LoadShare(inertia, scale, float(np.std(best[1] * columns[:, 1]) / np.std(torque)))
