"""Implements searches: for the smallest harmful fault, the inputs that decide an outcome, and the
probability of a rare event.
"""
