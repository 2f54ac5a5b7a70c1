"""The control software and the PLC: one stage a file, named as the robot names it."""
