"""Geometry by the operations of the original control software, in their order and in double
precision.
"""
