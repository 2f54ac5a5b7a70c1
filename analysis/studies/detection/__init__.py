"""Which detector knows first, and how often it alarms for nothing."""
