"""Looks at a campaign before it runs and at its runs afterwards; nothing here decides an
outcome.
"""
