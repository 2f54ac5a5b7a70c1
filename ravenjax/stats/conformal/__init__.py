"""Thresholds with a guarantee from fault-free operations, and whether fresh ones are still like
them.
"""
