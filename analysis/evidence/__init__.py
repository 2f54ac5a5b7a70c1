"""Writes evidence for a risk file: tables, and an argument linked to runs and checksums."""
