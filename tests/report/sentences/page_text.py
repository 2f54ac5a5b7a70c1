"""A page as its reader has it: sections of sentences and tables, and numbers that are taken out one
by one.

A sentence is written as the page has it, with the expected numbers in place: `f"{count(3)} of
{count(7)} faults"`. What the page prints must be the expected value as rounded there; what was
found is taken out, so that in the end a digit that nobody expected is left over.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from html.parser import HTMLParser

INLINE = {"a", "b", "strong", "em", "i", "code", "abbr"}
UNREAD = {"script", "style", "svg", "figure", "button", "nav"}
VOID = {"meta", "link", "br", "img", "input", "hr", "col"}
DASH = "–"
_NUMBER = r"−?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?"
_MARK = re.compile("\x01(.*?)\x02")


class Node:
    """One element: tag, attributes, and its children, elements and text."""

    def __init__(self, tag: str, attributes: dict[str, str | None]) -> None:
        self.tag, self.attributes = tag, attributes
        self.children: list[Node | str] = []

    def all(self, tag: str = "", name: str = "") -> Iterator[Node]:
        """Elements inside, in order, of a tag and of a class or id."""
        for child in self.children:
            if isinstance(child, Node):
                own = {*(child.attributes.get("class") or "").split(), child.attributes.get("id")}
                if (not tag or child.tag == tag) and (not name or name in own):
                    yield child
                yield from child.all(tag, name)

    def one(self, tag: str = "", name: str = "") -> Node:
        """The first of `all`."""
        found = next(self.all(tag, name), None)
        assert found is not None, f"the page has no {tag or 'element'} {name}"
        return found

    def without(self, *tags: str) -> Node:
        """A copy without elements of these tags or classes."""
        copy = Node(self.tag, self.attributes)
        for child in self.children:
            if isinstance(child, str):
                copy.children.append(child)
            elif not {child.tag, *(child.attributes.get("class") or "").split()} & set(tags):
                copy.children.append(child.without(*tags))
        return copy

    @property
    def words(self) -> str:
        """Its text as it is read."""
        return re.sub(r"\s+([.,;:)])", r"\1", re.sub(r"\s+", " ", "".join(self._text()))).strip()

    def _text(self) -> Iterator[str]:
        if self.tag in UNREAD:
            return
        apart = "" if self.tag in INLINE else " "
        yield apart
        for child in self.children:
            yield from child._text() if isinstance(child, Node) else (child,)
        yield apart


class _Parser(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.stack = [Node("page", {})]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        node = Node(tag, dict(attrs))
        self.stack[-1].children.append(node)
        if tag not in VOID:
            self.stack.append(node)

    def handle_endtag(self, tag: str) -> None:
        assert self.stack.pop().tag == tag

    def handle_data(self, data: str) -> None:
        self.stack[-1].children.append(data)


def parse(html: str) -> Node:
    """The page."""
    parser = _Parser()
    parser.feed(html)
    return parser.stack[0]


def rows(table: Node) -> list[list[Node]]:
    """Cells of the rows of a table's body."""
    return [
        [cell for cell in row.children if isinstance(cell, Node)]
        for row in table.one("tbody").all("tr")
    ]


def count(value: int) -> str:
    """A whole number, to the letter."""
    return f"\x01n{int(value)}\x02"


def number(value: float, digits: int = 3) -> str:
    """So many significant digits, trailing zeros left out; a dash where it is not finite."""
    return f"\x01s{digits} {float(value)!r}\x02" if math.isfinite(value) else DASH


def fixed(value: float, decimals: int) -> str:
    """So many decimals."""
    return f"\x01f{decimals} {float(value)!r}\x02"


def percent(fraction: float) -> str:
    """A fraction in percent, without the sign; at least one decimal."""
    return f"\x01p{100 * float(fraction)!r}\x02"


def signed(fraction: float) -> str:
    """A fraction in points with its sign, one decimal."""
    return f"\x01d{100 * float(fraction)!r}\x02"


ANY_TIME = "\x01h\x02"
"""Some hours, in the unit that suits them."""
ANY_SPAN = "\x01b\x02"
"""Two bounds of which a resample decides."""


def _pattern(sentence: str) -> str:
    made, last = [], 0
    for mark in _MARK.finditer(sentence):
        made.append(re.escape(sentence[last : mark.start()]))
        kind = mark[1][0]
        if kind == "b":
            made.append(f"({_NUMBER}(?:–| to ){_NUMBER})")
        elif kind == "h":
            made.append(f"({_NUMBER} (?:s|min|h))")
        else:
            made.append(f"([+]?{_NUMBER})" if kind == "d" else f"({_NUMBER})")
        last = mark.end()
    made.append(re.escape(sentence[last:]))
    return "".join(made)


def plain(sentence: str) -> str:
    """A sentence with its expected numbers in brackets, for messages."""
    return _MARK.sub(lambda mark: f"[{mark[1]}]", sentence)


def _agree(printed: str, mark: str) -> bool:
    kind, rest = mark[0], mark[1:]
    if kind in "bh":
        return True
    text = printed.replace(",", "").replace("−", "-")
    decimals = len(text.partition(".")[2])
    if kind == "n":
        return text == rest
    if kind == "p":
        return decimals >= 1 and abs(float(text) - float(rest)) <= 0.5 * 10**-decimals + 1e-9
    if kind == "d":
        value = float(rest)
        sign = text[0] in "+-" or float(text) == 0
        return sign and decimals == 1 and abs(float(text) - value) <= 0.05 + 1e-9
    digits, _, expected = rest.partition(" ")
    value = float(expected)
    if kind == "f":
        return decimals == int(digits) and abs(float(text) - value) <= 0.5 * 10**-decimals + 1e-9
    place = math.floor(math.log10(abs(value))) - int(digits) + 1 if value else 0
    return abs(float(text) - value) <= 0.5 * 10.0 ** min(place, 0) + 1e-9 * abs(value)


class Text:
    """Words of which claims are taken out."""

    def __init__(self, words: str, where: str) -> None:
        self.words, self.where = words, where

    def says(self, sentence: str) -> None:
        """Take a sentence out; fails where it is absent, or where one of its numbers is another."""
        found = list(re.finditer(_pattern(sentence), self.words))
        assert found, f"{self.where} does not say: {plain(sentence)}\nbut: {self.words}"
        marks = _MARK.findall(sentence)
        right = [one for one in found if all(map(_agree, one.groups(), marks))]
        assert right, f"{self.where} says: {found[0][0]}\nexpected: {plain(sentence)}"
        self.words = self.words[: right[0].start()] + " " + self.words[right[0].end() :]

    def is_said(self, *phrases: str) -> None:
        """Nothing is left over: no digit, and none of these phrases, which only a claim may
        bring.
        """
        left = [phrase for phrase in phrases if phrase in self.words]
        assert not left, f"{self.where} says what it must not: {left} in: {self.words}"
        assert not re.search(r"\d", self.words), (
            f"{self.where} has a number that nobody expected: {self.words}"
        )


def cell(node: Node, expected: str, where: str) -> None:
    """A cell holds just this."""
    words = node.words
    found = re.fullmatch(_pattern(expected), words)
    assert found, f"{where}: {words!r}, expected {plain(expected)!r}"
    assert all(map(_agree, found.groups(), _MARK.findall(expected))), (
        f"{where}: {words!r}, expected {plain(expected)!r}"
    )
