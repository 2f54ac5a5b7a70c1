r"""Defines the words for what happened to a run: response, hazard and cue. Needs no JAX.

A run is compared with its *golden run*: the same operator, robot and random numbers without the
fault. definitions.toml defines each word, events.toml defines the events of stop rules and
searches, and docs/outcomes.md gives the reasons.

A check responded to the fault if it tripped more often or sooner than in the golden run. The action
of a user's check is in the campaign file (`[[check]] acts`). A check that only watches is no
response. If a campaign adds checks or detectors, the columns `built_in_response` and
`built_in_told_ms` contain the response of the built-in checks alone. An added check or detector may
stop the robot, and this stop may trip built-in checks. The columns therefore count only trips
before an added check or detector changed the course of the run.

Each robot defines when it is *live* (`Robot.live`). A robot that is not live may coast or drop. The
column `unintended_off_mm` contains this motion, which is no hazard. A run has **failed** if a
number of the robot, of its nominal model or of its observers becomes infinite or NaN
(`ravenjax.vocabulary.failures`). A failed run has no verdict and is in no rate.
"""
