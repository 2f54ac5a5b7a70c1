"""Inspects a campaign before it runs, and its runs afterwards, without changing an outcome."""
