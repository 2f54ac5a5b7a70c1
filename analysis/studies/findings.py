"""Runs a study, and writes and reads its files: findings as JSON, Markdown and HTML. Equal findings
give equal bytes: files contain neither times nor paths.
"""

import dataclasses
import json
import shlex
from collections import Counter
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

from ravenjax.campaign import loading, runner
from ravenjax.campaign.faults import design
from ravenjax.campaign.progress import OnProgress, Status
from ravenjax.document import html
from ravenjax.errors import StoreError, UserError
from ravenjax.report import wording
from ravenjax.store import manifest
from ravenjax.store.files import parse_json, require_writable, write_aside
from studies import NAMES, cells, claims
from studies.study import HERE, Context, Findings, Study, plain, standings, targets

Record = Mapping[str, Any]
"""Content of findings.json."""

JSON, PAGE, HTML, CREDIBILITY = "findings.json", "findings.md", "findings.html", "credibility.md"
RUNS = "runs"  # subfolder of a study for its campaigns


def reproduce(
    study: Study, out: Path, engine: str = "auto", on_progress: OnProgress | None = None
) -> Findings:
    """Run a study, or finish it if OUT/NAME holds a part of it, and write its findings there.
    `on_progress`: called with the progress over all campaigns. Raises UserError and StoreError.
    """
    folder = out / study.name
    configs = {
        variant.name: loading.load_campaign(variant.campaign, variant.overrides)
        for variant in study.variants
    }
    if len(configs) < len(study.variants):
        raise ValueError(f"study {study.name}: two variants share a name, and so a folder")
    due = {name: design.count_due_rows(config) for name, config in configs.items()}
    latest: dict[str, Status] = {}

    def tell(phase: str, /, **told: Status) -> None:
        latest.update(told)
        if on_progress is not None and latest:
            on_progress(_pooled(phase, latest, due))

    folders = {name: folder / RUNS / name for name in configs}
    for name, config in configs.items():
        runner.run_campaign(
            config,
            folders[name],
            engine,
            on_progress=lambda status, name=name: tell("run", **{name: status}),
        )
    tell("compare")
    findings = study.compare(Context(folders, engine))
    write(study, findings, _provenance(study, folders), folder)
    return findings


def _pooled(phase: str, latest: Mapping[str, Status], due: Mapping[str, int]) -> Status:
    """Return the progress over campaigns from that of each begun one. `due`: numbers of runs."""
    parts, total = list(latest.values()), sum(due.values())
    share = sum(due[name] * part.progress for name, part in latest.items()) / max(1, total)
    return dataclasses.replace(
        parts[-1],
        phase=phase,
        total=total,
        progress=1.0 if phase == "compare" else share,
        failures=sum((Counter(part.failures) for part in parts), Counter()),
        done=sum(part.done for part in parts),
        compile_s=sum(part.compile_s for part in parts),
        run_s=sum(part.run_s for part in parts),
    )


def _provenance(study: Study, folders: Mapping[str, Path]) -> dict[str, Any]:
    campaigns, first = [], None
    for variant in study.variants:
        made = manifest.read_manifest(folders[variant.name])
        first, shown = first or made, [*map(_without_folder, variant.overrides)]
        # A study's own campaign, from the folder of the checkout
        campaign = variant.campaign.removeprefix(f"{HERE.parents[1]}/")
        words = ["ravenjax", "run", campaign, *(w for o in shown for w in ("--set", o))]
        campaigns.append(
            {
                "variant": variant.name,
                "campaign": campaign,
                "overrides": shown,
                "question": variant.question,
                "runs": made.due,
                "seconds": made.duration_ms / 1e3,
                "seed": made.seed,
                "config_hash": made.config_hash,
                "command": shlex.join(words),
            }
        )
    return {
        "engine": first.engine if first else "",
        "device": first.device if first else "",
        "code_hash": manifest.code_hash(),
        "versions": first.versions if first else manifest.package_versions(),
        "campaigns": campaigns,
    }


def _without_folder(text: str) -> str:
    """Return an override in which an absolute path is replaced by the file's name."""
    key, equals, value = text.partition("=")
    bare = value.strip("\"'")
    return f"{key}{equals}{PurePath(bare).name}" if bare.startswith(("/", "~")) else text


# --- files ---


def write(study: Study, findings: Findings, made: Record, folder: Path) -> None:
    """Write all files of these findings into `folder`. Raises StoreError if the disk refuses."""
    names = ("name", "title", "source", "question", "targets")
    about = {name: plain(getattr(study, name)) for name in names}
    record = {"study": about, **plain(findings), "provenance": made}
    text = page(record, with_claims=True)
    _write(folder, {PAGE: text, HTML: html.from_markdown(text, {}), JSON: _json(record)})


def keep(source: Path, target: Path) -> None:
    """Copy the findings in folder `source` into folder `target`. Raises StoreError."""
    record = read(source)
    _write(target, {PAGE: page(record, with_claims=False), JSON: _json(record)})


def read(folder: Path) -> dict[str, Any]:
    """Return the record of findings in a folder. Raises StoreError."""
    try:
        return parse_json((folder / JSON).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StoreError(
            f"{folder / JSON}: no findings there ({error}); run `ravenjax reproduce` first"
        ) from None


def records(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the records of all studies in a folder, in their order. Raises StoreError, and
    UserError if there are none.
    """
    found = {name: read(folder / name) for name in NAMES if (folder / name / JSON).is_file()}
    if not found:
        raise UserError(
            f"{folder}: no findings of a study there; the repository has some in results/reference,"
            f" and `ravenjax reproduce NAME --out {folder}` writes them"
        )
    return found


def write_credibility(folder: Path) -> Path:
    """Write the page over the studies in the folder. Raises StoreError."""
    _write(folder, {CREDIBILITY: claims.page(records(folder))})
    return folder / CREDIBILITY


def _json(record: Record) -> str:
    return json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _write(folder: Path, files: Mapping[str, str]) -> None:
    require_writable(folder)
    for name, text in files.items():
        write_aside(folder / name, lambda target, text=text: target.write_bytes(text.encode()))


# --- text ---

BRIEF_COLUMNS = ("quantity", "published", "predicted", "band", "inside")
INSIDE = {True: "yes", False: "NO", None: ""}


def line_rows(record: Record) -> list[tuple[str, ...]]:
    """Return the columns BRIEF_COLUMNS of each line: numbers without their origin."""
    return [tuple(cell.partition(";")[0] for cell in _line(one)[:-1]) for one in record["lines"]]


def page(record: Record, with_claims: bool) -> str:
    """Return the Markdown page of a record, with or without the evidence of its claims."""
    values = {
        **record,
        "standings": standings(record["lines"]),
        "targets": targets(),
        "compared": any(line["published"] for line in record["lines"]),
        "columns": (*BRIEF_COLUMNS, "likely reason for a difference"),
        "lines": [*map(_line, record["lines"])],
        "claims": claims.section(record) if with_claims else "",
    }
    return claims.fill_page("findings.md.j2", **values)


def _line(line: Record) -> tuple[str, ...]:
    def estimate(found: Record | None) -> str:
        if found is None:
            return wording.DASH
        text, over = cells.with_interval(found), cells.counted_over(found)
        return f"{text}; {over}" if over else text

    return (
        ": ".join(filter(None, (line["target"], line["quantity"])))
        + (f", {line['unit']}" if line["unit"] else ""),
        estimate(line["published"]),
        estimate(line["predicted"]),
        "" if line["band"] is None else cells.span(*line["band"]),
        INSIDE[line["passed"]],
        line["reason"],
    )
