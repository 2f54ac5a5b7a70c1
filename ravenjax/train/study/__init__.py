"""Studies with participants: assignment, comparison of groups, page."""
