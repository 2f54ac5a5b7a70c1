"""What became of each hazard of a session: when it struck, could be known, was felt, was answered; and what it did."""

from ravenjax.trainer.judge.episode import COLUMNS
from ravenjax.trainer.judge.judge import Judge

__all__ = ["COLUMNS", "Judge"]
