"""Names in the package: a local is called by a noun, and no two public classes share a name."""

from __future__ import annotations

import ast
import collections
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1] / "ravenjax"

INSTEAD = {
    "found": "what it is: path, rows, match, result, ..",
    "told": "what it says: lines, text, reply, flags, ..",
    "kept": "what is left: columns, indices, mask, ..",
    "given": "what came in: value, options, entries, ..",
    "made": "what came out: record, columns, strike, ..",
    "known": "what is there: names, keys, constants, ..",
    "shown": "what one sees: text, entries, figure, ..",
    "seen": "what was measured: signals, responses, ..",
    "wrong": "what is said of it: complaints, errors, invalid, ..",
    "drawn": "what was drawn: samples, weights, axes, ..",
    "asked": "what is wanted: request, conditions, target, ..",
    "held": "what it holds: blocks, size, state, ..",
    "taken": "what was taken: counts, chunk, increments, ..",
    "spoken": "what was said: words, points, ..",
    "struck": "what is struck: fault, hazards, hits, ..",
    "handed": "what is handed on: message, values, ..",
    "chosen": "what was chosen: mask, ids, engine, setting, ..",
    "said": "what was said: lines, summary, entries, ..",
}
"""Participles that say how a value came about, and what to say instead: what the value is."""


def modules() -> Iterator[tuple[str, ast.Module]]:
    for path in sorted(ROOT.rglob("*.py")):
        yield str(path.relative_to(ROOT.parent)), ast.parse(path.read_text(encoding="utf-8"))


def participles(tree: ast.AST) -> Iterator[ast.Name]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in INSTEAD:
            yield node


def test_no_local_is_named_by_a_participle() -> None:
    complaints = [
        f"{file}:{node.lineno}: {node.id!r} is no noun; name {INSTEAD[node.id]}"
        for file, tree in modules()
        for node in participles(tree)
    ]
    assert not complaints, "\n" + "\n".join(complaints)


def test_no_public_class_name_occurs_twice() -> None:
    places = collections.defaultdict(list)
    for file, tree in modules():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(f"{file}:{node.lineno}")
    complaints = [
        f"class {name} is defined in {', '.join(where)}; name each after its own thing, as"
        f" {_example(where[0], name)}"
        for name, where in sorted(places.items())
        if len(where) > 1
    ]
    assert not complaints, "\n" + "\n".join(complaints)


def _example(place: str, name: str) -> str:
    """EstimatorParams for Params in estimator.py."""
    words = Path(place.partition(":")[0]).stem.strip("_").split("_")
    return "".join(word.capitalize() for word in words) + name


def test_the_check_sees_a_name_wherever_it_is_bound() -> None:
    text = (
        "def f(x):\n    found = [told for told in x]\n    if (kept := x):\n        pass\n    return"
        " found, kept\n"
    )
    assert sorted(node.id for node in participles(ast.parse(text))) == ["found", "kept", "told"]
    assert not list(
        participles(
            ast.parse("def f(found):\n    return found\nclass C:\n    def told(self): ...\n")
        )
    )


def test_the_example_is_a_name_of_its_own() -> None:
    assert (
        _example("ravenjax/robots/raven2/stages/motor_control.py:12", "Params")
        == "MotorControlParams"
    )
