"""Judges each hazard of a session: when it struck, could be known, was felt and answered, and
what the robot did.
"""

from ravenjax.train.judge.row import COLUMNS
from ravenjax.train.judge.watch import Judge

__all__ = ["COLUMNS", "Judge"]
