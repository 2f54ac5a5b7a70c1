"""What a console's datagrams ask of the robot in one tick: increments in the ITP frame, one
entry an arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console.packet import U_STRUCT, Packet
from ravenjax.robots.raven2.geometry.mapping import quat_mul
from ravenjax.train.session.hands import unit


class Increments(NamedTuple):
    """Of one datagram, or of several that arrived together."""

    sequence: int  # of the last datagram, unsigned
    pedal: int  # 1: down; of the last datagram
    delta_um: tuple[tuple[int, int, int], ...]  # um
    quat: tuple[tuple[float, float, float, float], ...]  # x, y, z, w
    grasp_mrad: tuple[int, ...]  # mrad, positive closes

    def message(self, arms: Sequence[str], source: str = "itp") -> dict[str, Any]:
        """The command "increments" of `messages` for these arms."""
        return {
            "type": "increments",
            "source": source,
            "pedal": bool(self.pedal),
            "arms": {
                arm: {"delta_um": list(delta), "quat": list(quat), "grasp_mrad": grasp}
                for arm, delta, quat, grasp in zip(
                    arms, self.delta_um, self.quat, self.grasp_mrad, strict=True
                )
            },
        }

    def packet(self, sequence: int) -> Packet:
        """What the network hands to the robot, under another number."""
        return Packet(
            received=1,
            size=U_STRUCT.itemsize,
            sequence=sequence,
            delta=tuple(map(Vec, self.delta_um)),
            quat=tuple(map(Vec, self.quat)),
            grasp=self.grasp_mrad,
            surgeon_mode=self.pedal,
        )


def merge(many: Sequence[Increments]) -> Increments | None:
    """Everything in `many`, in their order, as one: displacements add up, later turns come after
    earlier ones.
    """
    return reduce(_followed, many) if many else None


def _followed(first: Increments, then: Increments) -> Increments:
    return Increments(
        then.sequence,
        then.pedal,
        tuple(
            (a[0] + b[0], a[1] + b[1], a[2] + b[2])
            for a, b in zip(first.delta_um, then.delta_um, strict=True)
        ),
        tuple(_turned(a, b) for a, b in zip(first.quat, then.quat, strict=True)),
        tuple(a + b for a, b in zip(first.grasp_mrad, then.grasp_mrad, strict=True)),
    )


def _turned(first: Sequence[float], then: Sequence[float]) -> tuple[float, float, float, float]:
    """The turn `first` followed by `then`, a unit quaternion."""
    return unit(quat_mul(Vec(then), Vec(first)))
