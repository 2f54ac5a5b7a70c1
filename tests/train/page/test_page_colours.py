"""Colours differ for whoever lacks one kind of cone, and are the same in the scene, the field
and the debrief.
"""

from __future__ import annotations

import itertools
import re
from importlib import resources

import numpy as np
import pytest

NAMES = ("gold", "green", "model", "goal", "done")
LEAST = 20  # of CIELAB; what just differs is 2.3
GROUND = "#151c24"

# Machado, Oliveira, Fernandes 2009, severity 1: linear RGB of what is seen.
SEEN = {
    "all cones": np.eye(3),
    "no long": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "no middle": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "no short": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
XYZ = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)  # of linear sRGB


def _linear(rgb: tuple[int, ...]) -> np.ndarray:
    share = np.array(rgb) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _lab(linear: np.ndarray) -> np.ndarray:
    ratio = XYZ @ np.clip(linear, 0, 1) / (XYZ @ np.ones(3))
    x, y, z = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16 / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def _rgb(text: str) -> tuple[int, ...]:
    return tuple(bytes.fromhex(text.removeprefix("#")))


def _colours(package: str, file: str, form: str) -> dict[str, tuple[int, ...]]:
    text = resources.files(package).joinpath(file).read_text()
    found = {name: re.search(form.format(name), text) for name in NAMES}
    return {name: _rgb(match[1]) for name, match in found.items() if match}


FIELD = _colours("ravenjax.train.page.static", "plots.js", r'\b{}: "(#\w{{6}})"')


@pytest.mark.parametrize("cones", SEEN)
def test_two_colours_differ_and_each_stands_out_from_the_field(cones: str) -> None:
    for one, other in itertools.combinations(NAMES, 2):
        a, b = (_lab(np.array(SEEN[cones]) @ _linear(FIELD[name])) for name in (one, other))
        assert np.linalg.norm(a - b) > LEAST, (one, other)
    for name in NAMES:
        above, ground = (0.05 + XYZ[1] @ _linear(rgb) for rgb in (FIELD[name], _rgb(GROUND)))
        # WCAG 2.2 asks for 3 of shapes, 4.5 of text.
        assert above / ground > 4.5, name
