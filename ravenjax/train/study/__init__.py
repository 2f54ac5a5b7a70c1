"""Evaluates studies with participants: design, comparison of groups, page."""
