"""Loads console profiles: bundled ones by name, or the user's files."""
