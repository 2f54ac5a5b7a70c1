"""`ravenjax bench`: how fast this machine runs the tick, with each engine and beside MuJoCo's
own ways.
"""
