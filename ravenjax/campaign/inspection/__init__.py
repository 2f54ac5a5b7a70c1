"""Inspects a campaign before it runs and its runs afterwards. Nothing in this package decides an
outcome.
"""
