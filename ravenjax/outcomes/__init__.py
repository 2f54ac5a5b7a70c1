r"""Defines the words for what happened to a run: response, hazard and cue. Needs no JAX.

A run is compared with its *golden run*: the same operator, robot and random numbers without the
fault. definitions.toml defines each word, events.toml defines the events of stop rules and
searches, and docs/outcomes.md gives the reasons.

A check counts if it tripped more often or sooner than in the golden run. A user's check counts with
the action that the campaign file gives it (`[[check]] acts`). A check that only watches does not
count. If a campaign adds checks or detectors, the columns `built_in_response` and
`built_in_told_ms` have the response of the built-in checks alone. If an added check or detector
changed the course of a run, these columns count only what the built-in checks did before this
change, because a stop makes built-in checks trip too.

Each robot defines when it is *live* (`Robot.live`). The column `unintended_off_mm` has the motion
while the robot is not live (it coasts, or drops). This motion is no hazard. A run has
**failed** if a number of the robot, of its nominal model or of its observers becomes infinite or
NaN (`ravenjax.vocabulary.failures`). A failed run has no verdict and is in no rate.
"""
