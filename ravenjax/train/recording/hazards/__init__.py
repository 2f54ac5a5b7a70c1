"""The hazards of a session: the table that it wrote, or its events where it was cut short."""
