"""Runs a study: its campaigns into folders, resumable like any campaign, then its comparison,
then its files.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from ravenjax.campaign import loading, runner
from ravenjax.campaign.faults import design
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.progress.counts import OnProgress, Status
from ravenjax.store import manifest
from studies import catalogue
from studies.framework import writing
from studies.framework.provenance import CampaignRecord, Provenance, shown_override
from studies.framework.study import Context, Findings, Study, Variant

RUNS = "runs"
"""Folder of a study's campaigns, inside the study's own."""


def reproduce(
    name: str, out: Path, engine: str = "auto", on_progress: OnProgress | None = None
) -> Findings:
    """Run the study of that name, or finish it where OUT/NAME holds a part of it, and write its
    findings there.

    on_progress: told how far all campaigns of the study are together. Raises UserError and
    StoreError for what the user can mend; finished parts stay.
    """
    return run(catalogue.find(name), out, engine, on_progress)


def run(
    study: Study, out: Path, engine: str = "auto", on_progress: OnProgress | None = None
) -> Findings:
    """As `reproduce`, of a study at hand."""
    folder = out / study.name
    configs = {
        variant.name: loading.load(variant.campaign, variant.overrides)
        for variant in study.variants
    }
    if len(configs) < len(study.variants):
        raise ValueError(f"study {study.name}: two variants share a name, and so a folder")
    whole = _Whole([design.due(config) for config in configs.values()], on_progress)
    folders = {}
    for number, (variant, config) in enumerate(configs.items()):
        folders[variant] = folder / RUNS / variant
        runner.run_campaign(config, folders[variant], engine, on_progress=whole.of(number))
    whole.compare()
    findings = study.compare(Context(folders, engine))
    writing.write(study, findings, _provenance(study, configs, folders), folder)
    return findings


def _provenance(
    study: Study, configs: dict[str, CampaignConfig], folders: dict[str, Path]
) -> Provenance:
    records = {name: manifest.read(folder) for name, folder in folders.items()}
    any_record = next(iter(records.values()), None)

    def campaign(variant: Variant) -> CampaignRecord:
        record = records[variant.name]
        return CampaignRecord(
            variant=variant.name,
            campaign=variant.campaign,
            overrides=tuple(shown_override(text) for text in variant.overrides),
            question=variant.question,
            runs=record.due,
            seconds=record.duration_ms / 1e3,
            seed=record.seed,
            config_hash=record.config_hash,
        )

    return Provenance(
        engine=any_record.engine if any_record else "",
        device=any_record.device if any_record else "",
        code_hash=manifest.code_hash(),
        lock_hash=manifest.lock_hash(),
        versions=any_record.versions if any_record else manifest.package_versions(),
        campaigns=tuple(campaign(variant) for variant in study.variants),
    )


class _Whole:
    """Several campaigns as one progress: runs are counted together, the share by campaigns."""

    def __init__(self, runs: list[int], on_progress: OnProgress | None) -> None:
        self._runs, self._on_progress = runs, on_progress
        self._last: dict[int, Status] = {}

    def of(self, number: int) -> Callable[[Status], None]:
        """What campaign `number` tells its progress to."""

        def told(status: Status) -> None:
            self._last[number] = status
            self._tell("run")

        return told

    def compare(self) -> None:
        """The campaigns are done, their series are measured."""
        self._tell("compare")

    def _tell(self, phase: str) -> None:
        if self._on_progress is None or not self._last:
            return
        statuses = list(self._last.values())
        runs = sum(self._runs)
        share = sum(self._runs[k] * status.progress for k, status in self._last.items()) / max(
            1, runs
        )
        self._on_progress(
            dataclasses.replace(
                statuses[-1],
                phase=phase,
                done=sum(status.done for status in statuses),
                total=runs,
                compile_s=sum(status.compile_s for status in statuses),
                run_s=sum(status.run_s for status in statuses),
                failed=sum(status.failed for status in statuses),
                progress=1.0 if phase == "compare" else share,
            )
        )
