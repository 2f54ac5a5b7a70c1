"""Predictions of a recorded robot as a table, and in sentences that follow from it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from studies.dsn16.recording import horizons
from studies.dsn16.recording.horizons import HorizonError, RecordedStretch
from studies.framework.study import Table

NOTE = (
    f"On the half of the recording that no parameter was fitted to. Every {horizons.EVERY_MS} ms a"
    " prediction starts from the recorded joints and speeds; whole: one prediction from the"
    " beginning of that half to its end. Closed loop: asked for what the recorded robot was asked"
    " for; open loop: the motors get the recorded DAC. A null model knows nothing of the arm; bare"
    " rotors are motors with viscous friction whose cables are all cut. Mean of the absolute"
    " errors, then the largest. One recording is no sample, so there is no interval."
)


def table(title: str, part: RecordedStretch, errors: Sequence[HorizonError]) -> Table:
    """A row a model and horizon."""
    rows = tuple(
        (
            one.loop,
            one.model,
            "whole" if one.horizon_ms is None else one.horizon_ms,
            *(f"{mean:.3f}, {most:.2f}" for mean, most in zip(one.mean, one.largest, strict=True)),
        )
        for one in errors
    )
    heads = (f"{joint}, {unit}" for joint, unit in part.units.items())
    return Table(title, ("driven in", "model", "horizon, ms", *heads), rows, NOTE)


def sentences(part: RecordedStretch, errors: Sequence[HorizonError]) -> Iterator[str]:
    """Of each virtual robot in each loop: where it predicts better than a held velocity, and
    than every null model.
    """
    by_name = {(one.loop, one.model, one.horizon_ms): one for one in errors}
    for (loop, model), mine in _robots(errors).items():
        where = []
        for one in mine:
            velocity = by_name[horizons.NO_LOOP, horizons.HELD_VELOCITY, one.horizon_ms]
            where.append(f"{_when(one)} at {_joints(part, one.mean < velocity.mean)}")
        best = sum(
            int((one.mean < np.min([null.mean for null in _nulls(errors, one)], axis=0)).sum())
            for one in mine
        )
        cells = len(mine) * len(part.units)
        yield (
            f"{model[0].upper()}{model[1:]}, {loop}: its mean error is smaller than that of a held"
            f" velocity {'; '.join(where)}. It is smaller than that of every null model in {best}"
            f" of {cells} comparisons, one a joint and horizon."
        )


def _robots(errors: Sequence[HorizonError]) -> dict[tuple[str, str], list[HorizonError]]:
    """Errors of each virtual robot by loop and name, in the order of the table."""
    robots: dict[tuple[str, str], list[HorizonError]] = {}
    for one in errors:
        if not _is_null(one):
            robots.setdefault((one.loop, one.model), []).append(one)
    return robots


def _nulls(errors: Sequence[HorizonError], beside: HorizonError) -> list[HorizonError]:
    """Null models at the same horizon, in the same loop or in none."""
    loops = (beside.loop, horizons.NO_LOOP)
    return [
        one
        for one in errors
        if _is_null(one) and one.horizon_ms == beside.horizon_ms and one.loop in loops
    ]


def _is_null(one: HorizonError) -> bool:
    return one.model.startswith("null")


def _when(one: HorizonError) -> str:
    return "over the whole" if one.horizon_ms is None else f"after {one.horizon_ms} ms"


def _joints(part: RecordedStretch, better: np.ndarray) -> str:
    """`every joint`, `no joint`, or `2 of 3 joints (shoulder, elbow)`."""
    names = [joint for joint, is_better in zip(part.units, better, strict=True) if is_better]
    if len(names) in (0, len(part.units)):
        return "every joint" if names else "no joint"
    return f"{len(names)} of {len(part.units)} joints ({', '.join(names)})"
