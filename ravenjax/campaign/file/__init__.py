"""Defines and checks the campaign file: which keys it has, what they mean, and the error
messages.
"""
