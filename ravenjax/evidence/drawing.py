"""The argument as SVG: goals as boxes, strategies as parallelograms, contexts with round ends,
solutions as circles.

It reads from left to right, so that any number of solutions stands below each other. What is broken
is red; what rests on something broken has a red edge. That one goal rests on another, a count on
the runs, is not drawn: YAML says it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from markupsafe import escape

from ravenjax.evidence.record import BROKEN, OPEN, EvidenceRecord, Node

WIDTH, GAP, SPACE, MARGIN = (
    264,
    70,
    14,
    20,
)  # px: of a node, between columns, between rows, around all
LINE, PAD, RADIUS = 15, 9, 17  # px: height of a line of text, around it, of a solution's circle
LETTERS, SLANT = 36, 12  # of a line; px by which a strategy leans
TITLE = 46  # px above the nodes
MOST = 8
"""Solutions of one goal that are drawn, those that are broken first; YAML has all."""
INK, PAPER, EDGE = "#1f2933", "#ffffff", "#52606d"
RED, PINK, AMBER = "#b91c1c", "#fde2e2", "#a16207"
_FILL = {"goal": "#eef4fb", "strategy": "#f3f0fa", "context": "#f5f5f4", "solution": "#e6f4ea"}


class _Box(NamedTuple):
    """Where a node is: left edge and middle, px."""

    node: Node
    x: float
    y: float
    lines: tuple[str, ...]

    @property
    def height(self) -> float:
        return _height(self.lines)


def svg(evidence: EvidenceRecord) -> str:
    """The drawing as text."""
    boxes, links = _placed(evidence)
    width = max(box.x for box in boxes.values()) + WIDTH + MARGIN
    notice = textwrap.wrap(evidence.notice, int(width / 6.6))
    bottom = max(box.y + box.height / 2 for box in boxes.values()) + 2 * SPACE
    height = bottom + LINE * len(notice) + MARGIN
    broken = evidence.of_status(BROKEN)
    state = f"{len(broken)} nodes are broken" if broken else "every checksum holds"
    head = f"Argument of {evidence.written}" + (
        f", checked {evidence.checked}: {state}" if evidence.checked else ""
    )
    out = [
        (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}"'
            f' width="{width:g}" height="{height:g}" role="img" font-family="sans-serif"'
            f' font-size="12" fill="{INK}">'
        ),
        f"<title>{escape(head)}</title>",
        f"<desc>{escape(evidence.notice)}</desc>",
        (
            '<defs><marker id="solid" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8"'
            ' markerHeight="8" orient="auto"><path d="M0 0 8 4 0 8z"'
            f' fill="{EDGE}"/></marker><marker id="hollow" viewBox="0 0 8 8" refX="8" refY="4"'
            ' markerWidth="8" markerHeight="8" orient="auto"><path d="M0.5 0.8 7.5 4 0.5 7.2z"'
            f' fill="{PAPER}" stroke="{EDGE}"/></marker></defs>'
        ),
        f'<rect width="100%" height="100%" fill="{PAPER}"/>',
        (
            f'<text x="{MARGIN}" y="{MARGIN + 8}" font-size="14" font-weight="bold" '
            f'fill="{RED if broken else INK}">{escape(head)}</text>'
        ),
    ]
    for start, end in links:
        out.append(_link(boxes[start], boxes[end]))
    for box in boxes.values():
        out.extend(_drawn(box))
    out += [
        f'<text x="{MARGIN}" y="{bottom + LINE * (number + 1):g}">{escape(line)}</text>'
        for number, line in enumerate(notice)
    ]
    return "\n".join([*out, "</svg>"]) + "\n"


def _placed(evidence: EvidenceRecord) -> tuple[dict[str, _Box], list[tuple[str, str]]]:
    """Where each node stands that is drawn, and which are joined."""
    nodes = {node.name: node for node in evidence.nodes}
    below = {node.name: list(_shown(node, nodes)) for node in evidence.nodes}
    nodes |= {node.name: node for children in below.values() for node in children}
    column: dict[str, int] = {}

    def descend(name: str, depth: int, way: tuple[str, ...]) -> None:
        column[name] = max(column.get(name, 0), depth)
        for child in below.get(name, ()):
            if child.name not in way:
                descend(child.name, depth + 1, (*way, name))

    descend(evidence.nodes[0].name, 0, ())
    last = max(column.values())
    column |= {name: last for name in column if nodes[name].kind == "solution"}
    boxes: dict[str, _Box] = {}
    bottoms = {number: float(MARGIN + TITLE) for number in range(last + 1)}

    def place(name: str) -> None:
        if name in boxes:
            return
        node, lines = nodes[name], _words(nodes[name])
        x = MARGIN + column[name] * (WIDTH + GAP)
        boxes[name] = _Box(node, x, 0.0, lines)
        mine = [child.name for child in below.get(name, ()) if child.name not in boxes]
        for child in mine:
            place(child)
        if mine:
            y = max(
                bottoms[column[name]] + _height(lines) / 2,
                (boxes[mine[0]].y + boxes[mine[-1]].y) / 2,
            )
        else:  # below everything: a line from it to the right crosses nothing
            y = max(bottoms.values()) + _height(lines) / 2
        boxes[name] = _Box(node, x, y, lines)
        bottoms[column[name]] = y + _height(lines) / 2 + SPACE

    place(evidence.nodes[0].name)
    return boxes, [
        (name, child.name) for name in boxes for child in below.get(name, ()) if child.name in boxes
    ]


def _shown(node: Node, nodes: Mapping[str, Node]) -> Iterator[Node]:
    """What a node is joined to, contexts first; of many solutions some, and how many more."""
    yield from (nodes[name] for name in node.in_context_of)
    below = [nodes[name] for name in node.supported_by if {node.kind, nodes[name].kind} != {"goal"}]
    if len(below) <= MOST:
        yield from below
        return
    ordered = sorted(below, key=lambda one: one.status != BROKEN)
    yield from ordered[: MOST - 1]
    rest = len(below) - MOST + 1
    broken = sum(one.status == BROKEN for one in ordered[MOST - 1 :])
    yield Node(
        name=f"{node.name}…",
        kind="solution",
        text=f"and {rest:,} more files, in argument.yaml",
        status=BROKEN if broken else "holds",
        reason=f"{broken:,} of them are broken" if broken else "",
    )


def _words(node: Node) -> tuple[str, ...]:
    text = node.text if node.kind == "solution" else f"{node.name}  {node.text}"
    lines = textwrap.wrap(text, LETTERS - (5 if node.kind in ("solution", "strategy") else 0))
    if node.item is not None:
        lines.append(f"sha256 {node.item.sha256[:16]}..")
    if node.status == BROKEN and not node.supported_by:
        lines.append("BROKEN")
    if node.status == OPEN:
        lines += textwrap.wrap(f"OPEN: {node.reason}", LETTERS)
    return tuple(lines)


def _height(lines: tuple[str, ...]) -> float:
    return max(LINE * len(lines) + 2 * PAD, 2 * RADIUS)


def _link(start: _Box, end: _Box) -> str:
    """A line from one node to another, bent before its end."""
    x0, x1 = start.x + WIDTH, end.x
    bend = x1 - GAP
    context = end.node.kind == "context"
    colour = RED if end.node.status == BROKEN and not context else EDGE
    return (
        f'<path d="M{x0:g} {start.y:g}H{bend:g}C{bend + GAP / 2:g} {start.y:g} {x1 - GAP / 2:g}'
        f' {end.y:g} {x1 - 1:g} {end.y:g}" fill="none" stroke="{colour}"'
        f' marker-end="url(#{"hollow" if context else "solid"})"/>'
    )


def _drawn(box: _Box) -> Iterator[str]:
    """Shape and words of one node."""
    node, top = box.node, box.y - box.height / 2
    red, leaf = node.status == BROKEN, not node.supported_by
    fill = PINK if red and leaf else _FILL[node.kind]
    line = RED if red else AMBER if node.status == OPEN else EDGE
    style = f'fill="{fill}" stroke="{line}" stroke-width="{2 if red else 1}"'
    yield f'<g class="{node.kind} {node.status}" id="{escape(node.name)}">'
    if node.reason:
        yield f"<title>{escape(node.reason)}</title>"
    left = box.x + PAD
    if node.kind == "solution":
        left = box.x + 2 * RADIUS + PAD
        yield f'<circle cx="{box.x + RADIUS:g}" cy="{box.y:g}" r="{RADIUS}" {style}/>'
        name, place = (
            "…" if node.name.endswith("…") else node.name,
            f'x="{box.x + RADIUS:g}" y="{box.y + 4:g}"',
        )
        yield f'<text {place} font-size="11" text-anchor="middle">{escape(name)}</text>'
    elif node.kind == "strategy":
        left += SLANT
        right, bottom = box.x + WIDTH, top + box.height
        points = (
            f"{box.x + SLANT:g},{top:g} {right:g},{top:g} {right - SLANT:g},{bottom:g}"
            f" {box.x:g},{bottom:g}"
        )
        yield f'<polygon points="{points}" {style}/>'
    else:
        radius = min(box.height / 2, 20) if node.kind == "context" else 0
        yield (
            f'<rect x="{box.x:g}" y="{top:g}" width="{WIDTH}" height="{box.height:g}"'
            f' rx="{radius:g}" {style}/>'
        )
    first = box.y - LINE * (len(box.lines) - 1) / 2 + 4
    for number, words in enumerate(box.lines):
        bold = ' font-weight="bold"' if words == "BROKEN" else ""
        colour = f' fill="{RED}"' if red and leaf else ""
        yield (
            f'<text x="{left:g}" y="{first + LINE * number:g}"{bold}{colour}>{escape(words)}</text>'
        )
    yield "</g>"
