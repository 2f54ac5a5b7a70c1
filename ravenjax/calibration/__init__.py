"""Parameters of a robot from a log of it: which values make the virtual robot do what the logged one did?

    log -> replays with other parameters -> Gauss-Newton -> judgement on the part of the log kept back

`log` is what a log says, `table_file` reads one. `replay` is the closed loop: the logged robot's desired joints, the
same controller, encoders of 4000 counts. `parameters` are the unknowns with what is believed of them before. `fit`
finds the most probable values, `judgement` says how well the robot then predicts the part of the log that nothing was
fitted to, beside models that know nothing of the arm.

Everything is compared at the motors, where a Raven's encoders are: what lies behind the cables, backlash above all,
shows itself only in what it does to the motors.

The covariance of a fit is a guide to what the log tells, and no interval. On logs of 14 s of twenty virtual robots with
28 hidden values each, 70 % of the values lay where it promises 90 %: the fit ends somewhere along the ridge on which
motor and joint share their friction, and a joint that its motor hardly moves tells little.
"""
