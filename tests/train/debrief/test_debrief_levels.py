"""What a debrief tells of levels, from what a session keeps of them."""

from __future__ import annotations

import re

import synthetic_session as synthetic

from ravenjax.train.debrief import page

LEVEL = [
    {"title": "Drive <slowly>", "targets": 6, "within_s": 8.0},
    {"title": "Hold", "targets": 3, "within_s": 12.5},
    {"title": "Both", "targets": 2, "within_s": 20.0},
]
TASK = {"levels": 3, "levels_proficient": 1, "rounds_s_of_level": [[9.31, 7.5, 8.0], [14.0], []]}
SCENARIO = {"name": "l", "title": "L", "task": {"kind": "levels", "in_a_row": 2, "level": LEVEL}}


def rows(html):
    (section,) = re.findall(r'<section id="levels">.*?</section>', html, flags=re.S)
    cells = [
        re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row, flags=re.S)
        for row in re.findall(r"<tr>.*?</tr>", section)
    ]
    return [[re.sub(r"<(?!b>|/b>)[^>]+>", " ", cell).strip() for cell in row] for row in cells]


def test_every_round_stands_in_the_table_and_those_in_time_are_bold(tmp_path):
    folder = synthetic.write(
        tmp_path, [], recorded=False, scenario=SCENARIO, summary={"task": TASK}
    )
    _, first, second, third = rows(page.render(folder))
    assert first == [
        "1. Drive &lt;slowly&gt; 6 targets",
        "8 s",
        "3",
        "7.5 s",
        "9.3, <b>7.5</b>, <b>8.0</b>",
        "yes",
    ]
    assert second == ["2. Hold 3 targets", "12.5 s", "1", "14.0 s", "14.0", "not yet"]
    assert third[2:] == ["0", "–", "none", "–"]
