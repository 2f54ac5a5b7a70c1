"""Connects sessions to robots and consoles over a network."""
