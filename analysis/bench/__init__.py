"""Implements `ravenjax bench`: how fast this machine runs the tick, with each engine and compared
with MuJoCo's own ways.
"""
