"""Judges each hazard of a session: when it struck, could be known, was felt and answered, and
what the robot did.
"""

from ravenjax.trainer.judge.row import COLUMNS
from ravenjax.trainer.judge.watch import Judge

__all__ = ["COLUMNS", "Judge"]
