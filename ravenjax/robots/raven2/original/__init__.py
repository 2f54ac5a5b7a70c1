"""Computes geometry with the operations of the original software, in their order and in double
precision.
"""
