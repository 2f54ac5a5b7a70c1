"""Writes evidence: tables, the argument, and the record that `--check` goes by."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from ravenjax.evidence import (
    argument,
    checking,
    control_actions,
    credibility,
    drawing,
    exchange,
    failure_modes,
    record,
    sentences,
    trace,
    workbook,
    yaml_text,
)
from ravenjax.evidence.credibility import ModelCredibility
from ravenjax.evidence.notice import NOTICE
from ravenjax.evidence.record import BROKEN, EvidenceRecord
from ravenjax.evidence.sources import Source, opened
from ravenjax.report import downloads
from ravenjax.store import manifest as manifests
from ravenjax.store.files import require_writable, sha256, write_aside

FOLDER = "evidence"
"""In a result folder, where no other is named."""
README, YAML, SVG = "README.md", "argument.yaml", "argument.svg"
GOALS = {
    "trace_matrix.csv": "Each group of faults is counted by hazard.",
    "trace.csv": (
        "Each run that ended in a hazard is named, with the checksum of the part that holds it."
    ),
    "failure_modes.csv": (
        "Each failure mode of each fault has its end effect, who detected it, its rate and its"
        " runs."
    ),
    "control_actions.csv": "Each hazard of motion is an unsafe control action of a stated kind.",
}
"""Tables, and what each is for."""
NO_ROWS = "result,campaign\n"
"""A table without a line."""


def write(
    folders: Sequence[Path],
    place: Path,
    xlsx: bool = False,
    reqif: bool = False,
    model: ModelCredibility | None = None,
) -> EvidenceRecord:
    """Evidence of result folders into the folder `place`; what is there of the same names is
    replaced.

    xlsx: the tables as one workbook, too. reqif: argument and failure modes for exchange, too.
    model: what the simulator's credibility rests on, for a report of it. Raises UserError and
    StoreError as `sources.opened`, `workbook.writer` and `exchange.require`, StoreError where the
    disk refuses.
    """
    if xlsx:
        workbook.writer()  # before any work
    if reqif:
        exchange.require()
    with opened(folders) as sources:
        require_writable(place)
        tables, makers = {}, _makers(sources)
        for name, goal in GOALS.items():
            write_aside(place / name, makers[name])
            tables[name] = goal, sha256(place / name)
        if xlsx:
            write_aside(
                place / workbook.FILE,
                lambda target: workbook.write(target, [place / name for name in GOALS]),
            )
            tables[workbook.FILE] = workbook.GOAL, sha256(place / workbook.FILE)
        else:  # one of before would have other numbers than the tables
            (place / workbook.FILE).unlink(missing_ok=True)
        linked = {}
        if model is not None:
            report = credibility.text(model, sources, place)
            write_aside(
                place / credibility.FILE, lambda target: target.write_text(report, encoding="utf-8")
            )
            tables[credibility.FILE] = credibility.GOAL, sha256(place / credibility.FILE)
            linked[credibility.FILE] = credibility.links(model, place)
        else:
            (place / credibility.FILE).unlink(missing_ok=True)
        evidence = EvidenceRecord(
            written=manifests.now(),
            sentences=tuple(line for source in sources for line in _sentences(source)),
            nodes=tuple(argument.build(sources, place, tables, linked)),
        )
        readme = "\n".join(_readme(sources, evidence)) + "\n"
        write_aside(place / README, lambda target: target.write_text(readme, encoding="utf-8"))
    if not reqif:
        (place / exchange.FILE).unlink(missing_ok=True)
    _write_argument(place, evidence, reqif)
    record.write(place, evidence)
    return evidence


def check(place: Path) -> EvidenceRecord:
    """Compute every checksum again, and write the argument as it stands now; the record stays as it
    is.

    Raises StoreError as `record.read`, and where the disk refuses; UserError as `exchange.require`
    where the evidence has a file of that kind.
    """
    reqif = (place / exchange.FILE).is_file()
    if reqif:
        exchange.require()
    evidence = checking.check(place, record.read(place))
    _write_argument(place, evidence, reqif)
    return evidence


def files(place: Path) -> list[Path]:
    """What `write` wrote, in order."""
    extras = [name for name in (workbook.FILE, credibility.FILE) if (place / name).is_file()]
    last = [name for name in (YAML, SVG, exchange.FILE) if (place / name).is_file()]
    return [place / name for name in (*GOALS, *extras, *last, README, record.FILE)]


def _write_argument(place: Path, evidence: EvidenceRecord, reqif: bool) -> None:
    texts = {YAML: yaml_text.text(evidence), SVG: drawing.svg(evidence)}
    if reqif:
        broken = {node.item.file for node in evidence.of_status(BROKEN) if node.item is not None}
        texts[exchange.FILE] = exchange.text(
            evidence, None if exchange.MODES in broken else place / exchange.MODES
        )
    for name, text in texts.items():
        write_aside(
            place / name, lambda target, text=text: target.write_text(text, encoding="utf-8")
        )


def _makers(sources: Sequence[Source]) -> dict[str, Callable[[Path], object]]:
    """Table -> what writes it."""

    def rows(lines: list) -> Callable[[Path], object]:
        text = downloads.text(lines) or NO_ROWS
        return lambda target: target.write_text(text, encoding="utf-8")

    modes = [row for source in sources for row in failure_modes.rows(source)]
    actions = [row for source in sources for row in control_actions.rows(source)]
    return {
        "failure_modes.csv": rows(modes),
        "control_actions.csv": rows(actions),
        "trace_matrix.csv": rows(list(trace.matrix(sources))),
        "trace.csv": lambda target: trace.write(target, sources),
    }


def _sentences(source: Source) -> list[str]:
    lines = [
        sentences.evading(source),
        sentences.complete(source),
        *sentences.by_hazard(source).values(),
    ]
    return [f"{source.name}, {source.record.campaign}: {line}" for line in lines]


def _readme(sources: Sequence[Source], evidence: EvidenceRecord) -> Iterator[str]:
    yield (
        f"# Evidence, {evidence.written}\n\n**{NOTICE}**\n\nThe sentence holds for each file of"
        " this folder.\n"
    )
    yield "## Results\n"
    for source in sources:
        record_of = source.record
        yield (
            f"- {source.name}: `{source.folder}`, campaign {record_of.campaign}, configuration "
            f"{record_of.config_hash}, code {record_of.code_hash}, engine {record_of.engine}"
        )
    yield "\n" + "\n".join(f"- {line}" for line in evidence.sentences)
    yield "\n## Tables\n\n" + "\n".join(f"- `{name}`: {goal}" for name, goal in GOALS.items())
    yield (
        "\nRates are over distinct faults: the first valid run of each in which nobody reacts, by"
        " the first fault of a run. They have Wilson's 95 % interval where the group's faults were"
        " drawn, and none where they were enumerated. A run without a valid outcome is in no rate;"
        " `failed_runs_of_group` counts it. Delays are medians in ms after the fault's first"
        " effect, over the runs in which the event came."
    )
    yield (
        "\n## How runs are mapped to unsafe control actions\n\nThe first line that applies"
        " decides:\n"
    )
    for number, kind in enumerate(control_actions.KINDS, start=1):
        yield f"{number}. {kind.meaning}: *{kind.name}*"
    yield (
        f"\n## Argument\n\n`{YAML}` and `{SVG}` have the same nodes. `ravenjax evidence --check"
        f" FOLDER` computes each checksum again and turns red what no longer holds. `{record.FILE}`"
        " is what it goes by: keep its own sha256 where nobody can change it."
    )
