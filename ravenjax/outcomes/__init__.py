"""Defines the words for what happened to a run: response, hazard and cue. Needs no JAX.

A run is compared with its *golden run*: the same operator, robot and random numbers without the
fault. definitions.toml has the meaning of each word, events.toml the events of stop rules and
searches, docs/outcomes.md the reasons.

    response                 hazard                      cue
    stopped ---------------> unintended motion --------> cue
    flagged ---------------> loss of motion -----------> no cue
    limited  \\ without      false report
    silent   /  an alarm     none

A check counts if it tripped more often or sooner than in the golden run. Users' checks count by
what they do (`[[check]] acts`); one that only watches does not count. The response of the built-in
checks alone is in `built_in_response` and `built_in_told_ms`, also in campaigns with a detector
that may stop the robot. If an added part changed the course of a run, they count only what the
built-in checks did before the change, because a stop makes built-in checks trip too.

Each robot defines when it is *live* (`Robot.live`). Motion while the robot is not live (it coasts,
or drops) is in the column `unintended_off_mm` and decides no hazard. A run has **failed** if a
number of the robot, of its nominal model or of its observers is no longer finite
(`ravenjax.vocabulary.failures`). It has no verdict and is in no rate.
"""
