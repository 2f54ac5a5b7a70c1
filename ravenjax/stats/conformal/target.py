"""What is promised: at most so many false alarms an hour, with so much confidence; and as the risk
of one operation.

An operation lasts T hours, and an alarm ends it, as an E-stop does. With A = 1 where it has an
alarm and H <= T the hours of it that count, the rate over many operations is E[A] over the mean
hours to the alarm or the end, and that is at most r where

    E[A] <= r E[(1 - A) H]

which leaves out what was worked before an alarm. That is linear, and the same as E[L] <= a for a
loss L in 0..1 of each operation by itself:

    L = A + (1 - A) r (T - H) / (1 + r T),        a = r T / (1 + r T)

Where all of T counts, L is A. Nothing is approximated; where alarms do not end operations, a is
about those with one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ravenjax.stats.intervals import alpha_of


class FalseAlarmTarget(NamedTuple):
    """A rate that is not exceeded, and how sure that is."""

    per_hour: float  # false alarms an hour, at most
    confidence: float  # that a calibration keeps it
    length_h: float  # of an operation, hours

    @property
    def risk(self) -> float:
        """Largest mean loss of an operation."""
        expected = self.per_hour * self.length_h
        return expected / (1.0 + expected)

    @property
    def fewest_units(self) -> int:
        """Independent units, none with an alarm, from which on the promise can be made at all: (1 -
        a)^n <= 1 - c.

        Hours of operation from independent operators are what counts: units times length is about
        -ln(1 - c) / r, whatever the length. ValueError unless rate and length are above 0 and the
        confidence lies between 0 and 1.
        """
        if not (
            self.per_hour > 0 and self.length_h > 0 and math.isfinite(self.per_hour * self.length_h)
        ):
            raise ValueError(
                f"a rate and a length lie above 0, got {self.per_hour} an hour and"
                f" {self.length_h} h"
            )
        # so that rounding does not ask for one more
        return max(
            1, math.ceil(math.log(alpha_of(self.confidence)) / math.log1p(-self.risk) - 1e-9)
        )

    @property
    def fewest_clusters(self) -> int:
        """The same for units of several operations, or of which not every hour counts, without any
        loss: a bet of 1 against the risk grows by 1 + a each, (1 + a)^n >= 1 / (1 - c). Hours that
        do not count ask for more."""
        return max(
            self.fewest_units,
            math.ceil(-math.log(alpha_of(self.confidence)) / math.log1p(self.risk) - 1e-9),
        )

    def without_alarm(self, hours: np.ndarray) -> np.ndarray:
        """Loss of operations without an alarm, by the hours of each that count; [operations].

        ValueError where hours are outside 0..T.
        """
        if not ((hours >= 0) & (hours <= self.length_h * (1 + 1e-9))).all():
            raise ValueError(
                f"hours of an operation lie in 0..{self.length_h:g}, got"
                f" {hours.min():g}..{hours.max():g}"
            )
        return (
            self.per_hour
            * np.maximum(self.length_h - hours, 0.0)
            / (1.0 + self.per_hour * self.length_h)
        )
