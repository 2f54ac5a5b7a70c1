"""Carrying rows to processes and clusters and their results back; nothing here decides an
outcome.
"""
