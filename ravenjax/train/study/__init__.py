"""Studies with participants: design, comparison of groups, page."""
