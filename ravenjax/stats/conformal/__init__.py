"""Sets thresholds with a guarantee from fault-free operations, and tests whether fresh operations
still resemble them.
"""
