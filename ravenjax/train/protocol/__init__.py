"""What the parts of a session tell each other: frames, messages, and the scene in plain numbers."""
