"""What a training session leaves: session.json, session.mcap, and its events in words."""
