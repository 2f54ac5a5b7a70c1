"""Geometry with the operations of the original control software in their order, double for
double.
"""
