"""Campaign, search and scenario files with anything wrong anywhere, and overrides of them: drawn
from a number each.
"""

import copy
import random
import string
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from ravenjax import resources
from ravenjax.analyses.search.file import loading as searches
from ravenjax.campaign import loading as campaigns
from ravenjax.train.scenario import loading as scenarios

KINDS: dict[str, tuple[str, Any, Any]] = {
    "campaign": ("campaigns", campaigns, campaigns.load_campaign),
    "search": (searches.FOLDER, searches, searches.load_search),
    "scenario": (scenarios.FOLDER, scenarios, scenarios.load_scenario),
}
"""What is mutated: the folder of its bundled files, and what reads them."""

NUMBERS = (0, 1, -1, 2, 7, 0.5, -0.25, 1e6, 1e-9, 1e308, -1e308, 2**31, -(2**31), 2**63, 10**30)
NUMBERS += (float("inf"), float("-inf"), float("nan"), 10**4400)
WORDS = (
    "",
    "*",
    "end",
    "gold",
    "green",
    "x" * 4000,
    "\0",
    "\u2028",
    "\ud7ff",
    "0",
    "²",
    "group",
    "nan",
    "[red]",
)
ATOMS: tuple[Any, ...] = (
    *NUMBERS,
    *WORDS,
    True,
    False,
    b"x".decode(),
    [],
    {},
    [[]],
    [{}],
    {"": {}},
)
FORMS = ("uniform", "loguniform", "normal", "choice", "list", "range")
TEXTS = (
    "inf",
    "nan",
    "[1, 2]",
    "[]",
    "{}",
    "{uniform = [0, 1]}",
    "1e999",
    "'x'",
    "[[[[1]]]]",
    "",
    "9" * 5000,
)
TEXTS += ("[" * 3000,)
DEEP, DEEP_ENOUGH = 2000, 20


class Mutant(NamedTuple):
    """One file that may be wrong, and overrides of it."""

    kind: str
    name: str  # of the bundled file that it is made of
    raw: Any  # tables; or the bytes of a file
    overrides: list[str]

    def read(self, folder: Path) -> Any:
        """What is made of it: UserError where it is refused."""
        _, module, load = KINDS[self.kind]
        if not isinstance(self.raw, bytes):
            return module.from_dict(self.raw, overrides=self.overrides)
        path = folder / f"{self.kind}.toml"
        path.write_bytes(self.raw)
        return load(path, self.overrides)


def mutant(number: int) -> Mutant:
    """The mutant of that number, the same ever again."""
    draw = random.Random(number)
    kind = draw.choice(list(KINDS))
    file = draw.choice(resources.list_resources(KINDS[kind][0], "*.toml"))
    content = file.read_bytes()
    overrides: list[str] = []
    tree = tomllib.loads(content.decode())
    match draw.choice(("tree", "tree", "text", "bytes", "overrides")):
        case "tree":
            raw: Any = _changed(draw, tree)
        case "text":
            raw = _rewritten(draw, content.decode()).encode("utf-8", "replace")
        case "bytes":
            raw = _damaged(draw, content)
        case _:
            raw = tree
            overrides = [_override(draw, tree) for _ in range(draw.randint(1, 3))]
    if draw.random() < 0.2:
        overrides.append(_override(draw, tree))
    return Mutant(kind, file.name, raw, overrides)


def _places(tree: Any, at: tuple = ()) -> Iterator[tuple]:
    if len(at) > DEEP_ENOUGH:
        return
    entries = (
        tree.items()
        if isinstance(tree, dict)
        else enumerate(tree)
        if isinstance(tree, list)
        else ()
    )
    for key, value in entries:
        yield (*at, key)
        yield from _places(value, (*at, key))


def _junk(draw: random.Random) -> Any:
    """A number, a word or a small table; now and then a deep one."""
    chance = draw.random()
    if chance < 0.55:
        return copy.deepcopy(draw.choice(ATOMS))
    if chance < 0.75:
        return {
            draw.choice(FORMS): [
                copy.deepcopy(draw.choice(ATOMS)) for _ in range(draw.randint(0, 3))
            ]
        }
    if chance < 0.8:
        deep: Any = 1
        wrap: Callable[[Any], Any] = draw.choice(
            (lambda x: [x], lambda x: {"a": x}, lambda x: {"parameters": x})
        )
        for _ in range(draw.choice((3, 40, DEEP))):
            deep = wrap(deep)
        return deep
    return [_junk(draw) for _ in range(draw.randint(0, 3))]


def _changed(draw: random.Random, tree: Any) -> Any:
    """One to four entries deleted, renamed, replaced, wrapped, doubled, swapped or added."""
    for _ in range(draw.randint(1, 4)):
        known = list(_places(tree))
        if not known:
            return _junk(draw)
        *parents, key = draw.choice(known)
        table = tree
        for parent in parents:
            table = table[parent]
        match draw.choice(
            ("delete", "replace", "replace", "replace", "wrap", "rename", "insert", "swap")
        ):
            case "delete":
                del table[key]
            case "replace":
                table[key] = _junk(draw)
            case "wrap":
                table[key] = draw.choice(([table[key]], {"a": table[key]}, [[table[key]]]))
            case "swap":
                other = draw.choice(list(table) if isinstance(table, dict) else range(len(table)))
                table[key], table[other] = table[other], table[key]
            case _ if isinstance(table, list):
                table.append(table[key])
            case "rename":
                table[draw.choice(("", "x", str(key) + "s", str(key)[:-1]))] = table.pop(key)
            case _:
                table[draw.choice(("x", "", "name", "value", "a.b", "kind"))] = _junk(draw)
    return tree


def _rewritten(draw: random.Random, text: str) -> str:
    """Lines of a file doubled, dropped, moved, or with another value."""
    lines = text.splitlines()
    for _ in range(draw.randint(1, 3)):
        at, other = draw.randrange(len(lines)), draw.randrange(len(lines))
        key, equals, _ = lines[at].partition(" = ")
        match draw.choice(("value", "value", "double", "drop", "swap")):
            case "value" if equals:
                lines[at] = f"{key} = {draw.choice(TEXTS)}"
            case "double":
                lines.insert(other, lines[at])
            case "drop" if len(lines) > 1:
                del lines[at]
            case _:
                lines[at], lines[other] = lines[other], lines[at]
    return "\n".join(lines)


def _damaged(draw: random.Random, content: bytes) -> bytes:
    at, length = draw.randrange(len(content)), draw.randint(0, 40)
    return content[:at] + draw.randbytes(draw.randint(0, 20)) + content[at + length :]


def _override(draw: random.Random, tree: Any) -> str:
    """`path=value`, of a path that is there, that is nearly there, or that is not."""
    path = [str(part) for part in draw.choice(list(_places(tree)))]
    match draw.choice(("there", "there", "beyond", "number", "deep", "noise")):
        case "beyond":
            path += draw.choices(
                ["a", "0", "name", "", "-1", "99999999999999999999", "²"], k=draw.randint(1, 3)
            )
        case "number":
            path[draw.randrange(len(path))] = draw.choice(["0", "1", "99", "-1", "*"])
        case "deep":
            path = [
                *path[: draw.randint(0, len(path))],
                *draw.choice("abc0") * draw.choice((5, 40, DEEP)),
            ]
        case "noise":
            path = ["".join(draw.choices(string.printable, k=draw.randint(0, 6)))]
    value = draw.choice(TEXTS) if draw.random() < 0.6 else f"{draw.choice(NUMBERS[:15])!r}"
    return ".".join(path) + draw.choice(("=", "=", "=", "=", " = ", "")) + value
