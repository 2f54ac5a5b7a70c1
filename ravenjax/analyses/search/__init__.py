"""Searches: the smallest harmful fault, the inputs that decide an outcome, the probability of a
rare event.
"""
