"""The task of peg transfer: take the object from its peg, carry it, and set it down on another peg.

It is kinematic, without contact. Jaws that close within `tolerance_mm` of the object take it along.
Jaws that open release it. Over its peg the object is placed. Elsewhere it drops to the tissue, from
where it must be fetched. The jaws are those of the true links, so a hazard that opens them drops
the object too.
"""

import math

import numpy as np

from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.messages import Json
from ravenjax.train.protocol.world import Point, tissue_height
from ravenjax.train.robot import ArmName
from ravenjax.train.scenario.config import PegTransfer
from ravenjax.train.tasks.base import Field, Task, Tips, Wish, round_point

CLOSED_RAD, OPEN_RAD = 0.8, 1.1
"""Jaw openings below which jaws hold and above which they release. The opening is 1.57 at home, and
0.67 with the 900 mrad of the generated motion of the same name.
"""
LIFT_M = 0.008
"""How high a scripted operator carries the object over pegs."""
PEG_RADIUS_M, OBJECT_RADIUS_M = 0.001, 0.002
COLOURS = {"peg": "#8a8f98", "object": "#c8553d"}


class PegTask(Task):
    """One object, transferred repeatedly. Two arms take turns."""

    def __init__(self, settings: PegTransfer, field: Field) -> None:
        super().__init__("peg_transfer", field)
        self.settings, self._arms = settings, field.arms
        self.pegs = _pegs(settings, field.middle)
        rng = np.random.default_rng([field.seed, settings.seed, 2])
        ways = [int(rng.integers(len(self.pegs)))]
        for _ in range(settings.transfers):
            ways.append(int(rng.choice([peg for peg in range(len(self.pegs)) if peg != ways[-1]])))
        self.ways = ways
        """The pegs on which the object is to be, in order."""
        self.object: Point = self.pegs[ways[0]]
        self.held: ArmName | None = None
        self.placed, self.dropped = 0, 0
        self.target = len(self.pegs)
        self._tolerance_m = settings.tolerance_mm / 1e3
        self._closed: dict[ArmName, bool] = dict.fromkeys(self._arms, False)

    @property
    def _arm(self) -> ArmName:
        return self._arms[self.placed % len(self._arms)]

    def _step(self, frame: Frame, tips: Tips, tick: int) -> None:
        for arm, closed in self._closed.items():
            opening = float(frame[f"{arm}/link_jpos"][5:7].sum(dtype=float))
            closes, opens = not closed and opening < CLOSED_RAD, closed and opening > OPEN_RAD
            if closes or opens:
                self._closed[arm] = closes
            if arm == self.held:
                self.object = tips[arm]
                if opens:
                    self._let_go(tick)
            elif (
                closes
                and self.held is None
                and math.dist(tips[arm], self.object) <= self._tolerance_m
            ):
                self.held = arm
                self.target = self.ways[self.placed + 1]
                self._record_object(tick)

    def _let_go(self, tick: int) -> None:
        x, y, z = self.object
        self.held, peg = None, self.pegs[self.ways[self.placed + 1]]
        self.target = len(self.pegs)
        if math.dist(self.object, peg) <= self._tolerance_m:
            self.object = peg
            self.placed += 1
            self.progress = self.placed / self.settings.transfers
        else:
            self.object = (x, y, min(z, tissue_height(x, y) + OBJECT_RADIUS_M))
            self.dropped += 1
        self._record_object(tick)
        if self.placed == self.settings.transfers:
            self._finish(tick)

    def _record_object(self, tick: int) -> None:
        self._record(tick, "object", held=self.held or "", at=round_point(self.object))

    def restart(self) -> None:
        """Put a held object back on its peg, because the robot that held it has moved away."""
        if self.held is not None:
            self.held, self.object = None, self.pegs[self.ways[self.placed]]
            self.target = len(self.pegs)
        self._closed = dict.fromkeys(self._arms, False)

    def wish(self, arm: ArmName, tip: Point) -> Wish | None:
        if self.done or arm != self._arm:
            return None
        holding = self.held == arm
        x, y, z = self.pegs[self.target] if holding else self.object
        aside = math.hypot(tip[0] - x, tip[1] - y)
        there = aside < 0.5 * self._tolerance_m and abs(tip[2] - z) < 0.5 * self._tolerance_m
        if holding and tip[2] < z + LIFT_M - 0.002 and aside > self._tolerance_m:
            return Wish((tip[0], tip[1], z + LIFT_M), True)  # lift it first
        over = z if aside < 0.5 * self._tolerance_m else z + LIFT_M
        return Wish((x, y, over), holding != there)

    def geometry(self) -> Json:
        pegs = [
            {
                "number": k,
                "top": round_point(top),
                "height_m": self.settings.height_mm / 1e3,
                "radius_m": PEG_RADIUS_M,
                "colour": COLOURS["peg"],
            }
            for k, top in enumerate(self.pegs)
        ]
        thing = {
            "number": len(self.pegs),
            "at": round_point(self.object),
            "radius_m": OBJECT_RADIUS_M,
            "colour": COLOURS["object"],
        }
        turns = {"arms": self._arms, "of": self.settings.transfers}
        return super().geometry() | {"pegs": pegs, "object": thing, "turns": turns}

    def _score(self) -> float:
        """Return the share of transfers done. A drop costs half a transfer."""
        return max(0.0, self.placed - 0.5 * self.dropped) / self.settings.transfers


def _pegs(settings: PegTransfer, middle: tuple[float, float]) -> list[Point]:
    spacing, per_row = settings.spacing_mm / 1e3, settings.pegs // 2
    tops = []
    for row in range(2):
        for k in range(per_row):
            x = middle[0] + spacing * (k - (per_row - 1) / 2.0)
            y = middle[1] + spacing * (row - 0.5)
            tops.append((x, y, tissue_height(x, y) + settings.height_mm / 1e3))
    return tops
