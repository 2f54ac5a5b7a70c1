"""Colours of the scene, RGB of 0 to 255: the two arms, the nominal model, the goal, what is done.

Each differs from the others for whoever lacks one kind of cone, too, and never stands alone: a
letter, a shape or dashes say the same. `static/plots.js`, `static/page.css` and the debrief's
`replay.js` have them as #rrggbb.
"""

from __future__ import annotations

GOLD, GREEN = (255, 196, 64), (31, 174, 132)
MODEL = (154, 220, 255)
GOAL = (245, 61, 240)
DONE = (118, 135, 154)
