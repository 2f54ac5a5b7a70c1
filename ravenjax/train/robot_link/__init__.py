"""Robots and consoles over a network: ITP in, joint state out, `ravenjax robot`, and a robot
elsewhere.
"""
