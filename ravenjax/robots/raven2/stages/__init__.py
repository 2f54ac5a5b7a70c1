"""The control software and the PLC: one stage per file, with the robot's name for the stage."""
