"""What of a task is drawn: the goal, the next and the last reached, and a ring as wide as the
tip is far.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from ravenjax.train.page.marks import GOAL, RING_M, TaskShapes


class Scene:
    """Keeps what is added, by name."""

    def __init__(self):
        self.nodes = {}

    def add_icosphere(self, name, radius, **settings):
        return self.nodes.setdefault(name, SimpleNamespace(visible=True, scale=1.0, **settings))

    def add_line_segments(self, name, points, colors, **settings):
        return self.nodes.setdefault(name, SimpleNamespace(points=points, scale=1.0, **settings))


@pytest.fixture
def drawn():
    scene = Scene()
    targets = [
        {
            "number": k,
            "arm": ("gold", "green")[k % 2],
            "at": [0.001 * k, 0.0, 0.2],
            "radius_m": 0.002,
            "colour": "#d9a441",
        }
        for k in range(300)
    ]
    return scene.nodes, TaskShapes(SimpleNamespace(scene=scene), {"targets": targets})


def test_of_three_hundred_targets_the_goal_its_neighbours_and_no_more(drawn):
    nodes, shapes = drawn
    shapes.show(40, {"gold": np.zeros(3), "green": np.zeros(3)})
    numbers = [k for k in range(300) if nodes[f"/task/target/{k}"].visible]
    assert numbers == [35, 36, 37, 38, 39, 40, 41]
    colours = {k: nodes[f"/task/target/{k}"].color for k in numbers}
    assert colours[40] == GOAL and len({colours[39], colours[40], colours[41]}) == 3
    scales = [nodes[f"/task/target/{k}"].scale for k in (39, 40, 41)]
    assert max(scales) == scales[1] == 1.0


def test_the_ring_shrinks_as_the_arm_whose_turn_it_is_comes_nearer(drawn):
    nodes, shapes = drawn
    goal, ring = np.array([0.010, 0.0, 0.2]), nodes["/task/ring"]
    for away in (0.020, 0.010, 0.005):
        shapes.show(10, {"gold": goal + (0.0, away, 0.0), "green": goal})
        assert (
            ring.visible
            and ring.scale == pytest.approx(away)
            and ring.position == pytest.approx(tuple(goal))
        )
    shapes.show(10, {"gold": goal, "green": goal})
    assert ring.scale == RING_M[0]
    shapes.show(-1, {"gold": goal, "green": goal})
    assert not ring.visible
