"""The argument in the goal structuring notation: goals over strategies, down to files with
checksums.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from ravenjax.evidence import sentences
from ravenjax.evidence.notice import NOTICE
from ravenjax.evidence.record import OPEN, Item, Node
from ravenjax.evidence.sources import Source, identity
from ravenjax.store import manifest as manifests
from ravenjax.store.folder import PARTS

TOP = "G1"
CLAIM = (
    "What each declared fault did to the simulated robot, and who was told of it, is known from"
    " recorded runs."
)
DEFINITIONS = (
    "Outcomes as ravenjax defines them (docs/outcomes.md); faults, checks and robot are simulated."
)
OVER_RESULTS = (
    "Argue result by result: all runs are there, and each hazard is counted over distinct faults."
)
OVER_TABLES = "Argue table by table: each number can be followed to the runs behind it."


class _Builder:
    """Collects nodes, and counts each kind."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._files: dict[tuple[str, str], str] = {}

    def add(self, letter: str, **fields: object) -> str:
        """A node of the kind that the letter begins; its name."""
        kind = {"G": "goal", "S": "strategy", "Sn": "solution", "C": "context"}[letter]
        name = f"{letter}{1 + sum(node.kind == kind for node in self.nodes)}"
        self.nodes.append(Node.model_validate({"name": name, "kind": kind, **fields}))
        return name

    def solution(self, text: str, item: Item) -> str:
        """The solution of this item; the same item is one solution wherever it is named."""
        key = item.file, item.of
        if key not in self._files:
            self._files[key] = self.add("Sn", text=text, item=item)
        return self._files[key]


def build(
    sources: Sequence[Source],
    place: Path,
    tables: Mapping[str, tuple[str, str]],
    links: Mapping[str, tuple[Item, ...]] | None = None,
) -> list[Node]:
    """Nodes, the top goal first. place: where the evidence is; tables: file there -> (goal that it
    is for, sha256); links: file there that is of no result -> files that it names."""
    builder, linked = _Builder(), links or {}
    files = {
        name: builder.solution(name, Item(file=name, sha256=digest, links=linked.get(name, ())))
        for name, (_, digest) in tables.items()
    }
    whole = [_complete(builder, source, place) for source in sources]
    results = [
        _result(builder, source, goal, files) for source, goal in zip(sources, whole, strict=True)
    ]
    goals = [
        builder.add("G", text=goal, supported_by=(files[name], *(() if name in linked else whole)))
        for name, (goal, _) in tables.items()
    ]
    contexts = (builder.add("C", text=DEFINITIONS), builder.add("C", text=NOTICE))
    strategies = [
        builder.add("S", text=OVER_RESULTS, supported_by=tuple(results)),
        builder.add("S", text=OVER_TABLES, supported_by=tuple(goals)),
    ]
    builder.add("G", text=CLAIM, supported_by=tuple(strategies), in_context_of=contexts)
    return _named_from_the_top(builder.nodes)


def _complete(builder: _Builder, source: Source, place: Path) -> str:
    """The goal that a result's runs are there; its name."""
    record, folder = source.record, Path(os.path.relpath(source.folder, place))
    parts = [
        builder.solution(
            f"{source.name}: rows {part.first:,} to {part.last:,}",
            Item(file=(folder / PARTS / part.file).as_posix(), sha256=part.sha256),
        )
        for part in sorted(record.parts, key=lambda part: part.first)
    ]
    what = builder.solution(
        f"{source.name}: manifest, what decides outcomes",
        Item(file=(folder / manifests.FILE).as_posix(), sha256=identity(record), of="campaign"),
    )
    whole = record.done == record.due
    missing = (
        {}
        if whole
        else {"status": OPEN, "reason": f"{record.due - record.done:,} runs are missing"}
    )
    return builder.add("G", text=sentences.complete(source), supported_by=(what, *parts), **missing)


def _result(builder: _Builder, source: Source, complete: str, files: Mapping[str, str]) -> str:
    """The goal of one result; its name. complete: that of the goal that its runs are there."""
    record = source.record
    traced = tuple(name for file, name in files.items() if file.startswith("trace"))
    goals = [complete]
    goals += [
        builder.add("G", text=text, supported_by=(*traced, complete))
        for text in sentences.by_hazard(source).values()
    ]
    context = builder.add(
        "C",
        text=(
            f"{source.name}: campaign {record.campaign}, configuration {record.config_hash[:16]},"
            f" code {record.code_hash[:16]}, engine {record.engine} on {record.device}, seed"
            f" {record.seed}."
        ),
    )
    strategy = builder.add(
        "S", text=f"{source.name}: argue over completeness and over hazards.", supported_by=goals
    )
    text = f"{source.name}, {record.campaign}: {sentences.evading(source)}"
    return builder.add("G", text=text, supported_by=(strategy,), in_context_of=(context,))


def _named_from_the_top(nodes: Sequence[Node]) -> list[Node]:
    """The same nodes in the order in which one reads them, numbered so."""
    by_name, order = {node.name: node for node in nodes}, []

    def walk(node: Node) -> None:
        if node not in order:
            order.append(node)
            for name in (*node.in_context_of, *node.supported_by):
                walk(by_name[name])

    walk(nodes[-1])
    counts: dict[str, int] = {}
    names = {}
    for node in order:
        letter = node.name.rstrip("0123456789")
        counts[letter] = counts.get(letter, 0) + 1
        names[node.name] = f"{letter}{counts[letter]}"
    return [
        node.model_copy(
            update={
                "name": names[node.name],
                "supported_by": tuple(names[name] for name in node.supported_by),
                "in_context_of": tuple(names[name] for name in node.in_context_of),
            }
        )
        for node in order
    ]
