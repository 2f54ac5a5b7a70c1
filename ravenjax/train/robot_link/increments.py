"""What a console's datagrams ask of the robot in one tick: increments in the ITP frame, one
entry an arm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ravenjax.numbers.vec import Vec
from ravenjax.train.robot import U_STRUCT, Packet, Quat, turn_by


class Increments(NamedTuple):
    """Of one datagram, or of several that arrived together."""

    sequence: int  # of the last datagram, unsigned
    pedal: int  # 1: down; of the last datagram
    delta_um: tuple[tuple[int, int, int], ...]  # um
    quat: tuple[Quat, ...]  # x, y, z, w
    grasp_mrad: tuple[int, ...]  # mrad, positive closes

    @staticmethod
    def of(message: Mapping[str, Any], arms: Sequence[str]) -> Increments:
        """Of a command "increments"."""
        tables = [message["arms"][arm] for arm in arms]
        return Increments(
            0,
            int(message["pedal"]),
            tuple(tuple(table["delta_um"]) for table in tables),
            tuple(tuple(table["quat"]) for table in tables),
            tuple(table["grasp_mrad"] for table in tables),
        )

    @staticmethod
    def still(arms: int) -> Increments:
        """The pedal is up, and nothing moves."""
        level = ((0.0, 0.0, 0.0, 1.0),) * arms
        return Increments(0, 0, ((0, 0, 0),) * arms, level, (0,) * arms)

    def message(self, arms: Sequence[str]) -> dict[str, Any]:
        """The command "increments" of `messages` for these arms."""
        each = zip(arms, self.delta_um, self.quat, self.grasp_mrad, strict=True)
        return {
            "type": "increments",
            "source": "itp",
            "pedal": bool(self.pedal),
            "arms": {
                arm: {"delta_um": list(delta), "quat": list(quat), "grasp_mrad": grasp}
                for arm, delta, quat, grasp in each
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


def merge(increments: Sequence[Increments]) -> Increments | None:
    """All of them, in their order, as one: displacements add up, turns follow each other."""
    total = None
    for then in increments:
        if total is None:
            total = then
            continue
        deltas = zip(total.delta_um, then.delta_um, strict=True)
        total = Increments(
            then.sequence,
            then.pedal,
            tuple((a[0] + b[0], a[1] + b[1], a[2] + b[2]) for a, b in deltas),
            tuple(map(turn_by, total.quat, then.quat)),
            tuple(a + b for a, b in zip(total.grasp_mrad, then.grasp_mrad, strict=True)),
        )
    return total
