"""Keeps time and shares data: the clock, the realtime loop, and rings of memory between
processes.
"""
