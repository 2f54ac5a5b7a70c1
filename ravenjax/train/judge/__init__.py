"""Judges each hazard of a session.

It records when the hazard became active, could be known, was felt and was answered, and what the
robot did.
"""

from ravenjax.train.judge.row import COLUMNS
from ravenjax.train.judge.watch import Judge

__all__ = ["COLUMNS", "Judge"]
