"""What the parts of a session send each other: frames, messages, and the scene in plain numbers."""
