"""Estimates the parameters of a robot from a log of its joints.

The question is which parameter values make the virtual robot move as the logged robot did.

    log -> replays with other parameters -> Gauss-Newton -> judgement on the rest of the log

`joint_log` reads a log. `position_loop` is one cycle of the closed loop, with the same controller
and encoders of 4000 counts. `replays` turns it into a loop for the engines, and runs many replays
of one log. `parameters` defines the unknowns and their priors. `fit` finds
the most probable values. `calibrate` measures how well the robot then predicts the second half of
the log, to which nothing was fitted, and compares it with models that know nothing of the arm.

A log's joints are compared at the motors, where a Raven's encoders are. Effects behind the cables,
above all backlash, appear only through the motors.

The covariance of a fit is valid if the virtual robot differs from the logged one only in the
unknowns. A check used logs of 14 s from twenty virtual robots, each with 44 values drawn from the
beliefs. Of these 880 values, 847 lay inside their 90 % intervals, and at least 37 of 44 for each
robot. A real robot differs in more ways, so there the covariance is only a guide.
"""
