"""The control software alone, driven from Python."""
