"""Runs studies of the simulator with fewer and shorter campaigns than their findings have."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from studies import findings
from studies.study import Findings, Study

Overrides = tuple[str, ...]


@pytest.fixture
def reproduced(tmp_path: Path) -> Callable[..., Findings]:
    """Reproduces a study in `tmp_path`. Overrides: of every variant, or of the only ones to run."""

    def reproduce(study: Study, overrides: Overrides | Mapping[str, Overrides] = ()) -> Findings:
        variants = tuple(
            dataclasses.replace(one, overrides=(*one.overrides, *more))
            for one in study.variants
            for more in [overrides.get(one.name) if isinstance(overrides, Mapping) else overrides]
            if more is not None
        )
        return findings.reproduce(dataclasses.replace(study, variants=variants), tmp_path)

    return reproduce
