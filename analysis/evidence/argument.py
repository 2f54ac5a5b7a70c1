"""Builds the argument of a risk file in goal structuring notation, and draws it with Mermaid."""

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from evidence.record import NOTICE, EvidenceRecord, Item, Node, Source, identify
from ravenjax.report import wording
from ravenjax.report.sections import tables
from ravenjax.store import manifest as manifests
from ravenjax.store.folder import PARTS

CLAIM = (
    "What each declared fault did to the simulated robot, and whether a check raised an alarm, is"
    " known from recorded runs."
)
DEFINITIONS = (
    "Outcomes as ravenjax defines them (docs/outcomes.md); faults, checks and robot are simulated."
)
OVER_RESULTS = (
    "Argue result by result: all runs are there, and each hazard is counted over distinct faults."
)
OVER_TABLES = "Argue table by table: each number can be followed to the runs behind it."
KINDS = {"G": "goal", "S": "strategy", "Sn": "solution", "C": "context"}
SHAPES = {"goal": "rect", "strategy": "lean-r", "solution": "circle", "context": "rounded"}


def say_evading(source: Source) -> str:
    """Say how many of the faults evade the checks, in the words of the report's first sentence."""
    head = tables.headline_counts(source.runs, source.record)
    evaded, bounds = head["evaded"], ""
    if not evaded.n:
        return "No fault has a valid outcome." if head["faulty"] else "No run has a fault."
    if interval := wording.format_interval(evaded):
        share = wording.format_percent(evaded.value)
        bounds = f" ({share} of faults drawn so, 95 % interval {interval})"
    some = wording.format_count(evaded.k) if evaded.k else "none"
    return (
        f"Of {wording.count_noun(evaded.n, 'distinct fault')} of this design, {some} moved the live"
        f" robot more than {source.record.limit_mm:g} mm off its course without an alarm{bounds}."
    )


def say_complete(source: Source) -> str:
    record, failed = source.record, source.runs.count("failed")
    without = "each with a valid outcome"
    if failed:
        without = f"{wording.format_count(failed)} of them without a valid outcome"
    due = wording.count_noun(record.due, "declared run")
    return f"{wording.format_count(record.done)} of the {due} are there, {without}."


def say_hazards(source: Source) -> list[str]:
    """Say how many distinct faults ended in each hazard, and how many of these a check reported."""
    lines, rows = [], tables.verdict_matrix(source.runs)
    total = wording.count_noun(rows[0]["total"].n, "distinct fault")
    for hazard in dict.fromkeys(cell["hazard"] for cell in rows[0]["cells"]):
        counts = {
            row["name"]: sum(c["share"].k for c in row["cells"] if c["hazard"] == hazard)
            for row in rows
        }
        k, alarms = sum(counts.values()), counts["stopped"] + counts["flagged"]
        if hazard != "none" and k:
            told, untold = map(wording.format_count, (alarms, k - alarms))
            ended = f"{hazard.capitalize()}: {wording.format_count(k)} of {total}"
            check = f"a check raised an alarm or stopped the robot in {told}"
            lines.append(f"{ended}; {check}, and none did in {untold}.")
    return lines


def say_all(source: Source) -> list[str]:
    lines = [say_evading(source), say_complete(source), *say_hazards(source)]
    return [f"{source.name}, {source.record.campaign}: {line}" for line in lines]


def build_argument(
    sources: Sequence[Source],
    place: Path,
    goals: Mapping[str, tuple[str, str]],
    links: Mapping[str, tuple[Item, ...]],
) -> list[Node]:
    """Return the nodes, top goal first. `place`: folder of the evidence. `goals`: maps a file there
    to (its goal, sha256). `links`: maps a file of no result to the files that it names.
    """
    nodes: list[Node] = []

    def add(letter: str, text: str, *below: str, **fields: object) -> str:
        name = f"{letter}{1 + sum(node.kind == KINDS[letter] for node in nodes)}"
        fields |= {"name": name, "kind": KINDS[letter], "text": text, "supported_by": below}
        nodes.append(Node.model_validate(fields))
        return name

    files = {}
    for name, (_, digest) in goals.items():
        item = Item(file=name, sha256=digest, links=links.get(name, ()))
        files[name] = add("Sn", name, item=item)
    traced = [name for file, name in files.items() if file.startswith("trace")]
    results, complete = [], []
    for source in sources:
        record, folder = source.record, Path(os.path.relpath(source.folder, place))
        manifest = (folder / manifests.FILE).as_posix()
        item = Item(file=manifest, sha256=identify(record), of="campaign")
        proof = [add("Sn", f"{source.name}: manifest, what decides outcomes", item=item)]
        for part in sorted(record.parts, key=lambda part: part.first):
            item = Item(file=(folder / PARTS / part.file).as_posix(), sha256=part.sha256)
            proof.append(
                add("Sn", f"{source.name}: rows {part.first:,} to {part.last:,}", item=item)
            )
        missing = record.due - record.done
        state = {"status": "open", "reason": f"{missing:,} runs are missing"} if missing else {}
        complete.append(add("G", say_complete(source), *proof, **state))
        hazards = [add("G", text, *traced, complete[-1]) for text in say_hazards(source)]
        made = f"configuration {record.config_hash[:16]}, code {record.code_hash[:16]}"
        engine = f"engine {record.engine} on {record.device}, seed {record.seed}."
        context = add("C", f"{source.name}: campaign {record.campaign}, {made}, {engine}")
        text = f"{source.name}: argue over completeness and over hazards."
        strategy = add("S", text, complete[-1], *hazards)
        text = f"{source.name}, {record.campaign}: {say_evading(source)}"
        results.append(add("G", text, strategy, in_context_of=(context,)))
    of_files = [
        add("G", goal, files[name], *(() if name in links else complete))
        for name, (goal, _) in goals.items()
    ]
    contexts = (add("C", DEFINITIONS), add("C", NOTICE))
    strategies = (add("S", OVER_RESULTS, *results), add("S", OVER_TABLES, *of_files))
    add("G", CLAIM, *strategies, in_context_of=contexts)
    return _number_from_the_top(nodes)


def _number_from_the_top(nodes: Sequence[Node]) -> list[Node]:
    """Return the nodes in reading order, numbered in that order."""
    by_name, names, counts = {node.name: node for node in nodes}, dict[str, str](), Counter[str]()

    def walk(node: Node) -> None:
        if node.name not in names:
            letter = node.name.rstrip("0123456789")
            counts[letter] += 1
            names[node.name] = f"{letter}{counts[letter]}"
            for name in (*node.in_context_of, *node.supported_by):
                walk(by_name[name])

    walk(nodes[-1])
    renamed = []
    for name, number in names.items():
        node = by_name[name]
        changes: dict[str, object] = {"name": number}
        for field in ("supported_by", "in_context_of"):
            changes[field] = tuple(names[other] for other in getattr(node, field))
        renamed.append(node.model_copy(update=changes))
    return renamed


def draw_mermaid(evidence: EvidenceRecord) -> Iterator[str]:
    """Yield a flowchart of goals, strategies and contexts; of the files, only broken ones."""
    yield f"%% {evidence.notice}\nflowchart LR"
    yield "classDef broken fill:#fde2e2,stroke:#b91c1c\nclassDef open stroke:#a16207"
    shown = {n.name: n for n in evidence.nodes if n.kind != "solution" or n.status == "broken"}
    for node in shown.values():
        words = f"{node.name} {node.text} {node.reason}".strip()
        words = words.replace('"', "#quot;").replace("<", "#lt;")
        yield f'{node.name}@{{ shape: {SHAPES[node.kind]}, label: "{words}" }}'
        if node.status != "holds":
            yield f"class {node.name} {node.status}"
        yield from (f"{node.name} --> {name}" for name in node.supported_by if name in shown)
        yield from (f"{node.name} -.-> {name}" for name in node.in_context_of)
