"""The data that a session's parts exchange: frames, messages, and the scene in plain numbers."""
