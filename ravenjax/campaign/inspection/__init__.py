"""Inspects a campaign before it runs, and its runs afterwards. This package never changes an
outcome.
"""
