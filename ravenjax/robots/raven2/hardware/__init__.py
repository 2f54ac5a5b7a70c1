"""The virtual robot alone, for a user's control software."""
