"""An operator that is listened to."""

from __future__ import annotations


class RecordingOperator:
    """Passes on what an operator says, and keeps it."""

    def __init__(self, operator):
        self.operator = operator
        self.said = []

    def messages(self, tick, frame):
        messages = self.operator.messages(tick, frame)
        self.said += ((tick, message) for message in messages)
        return messages
