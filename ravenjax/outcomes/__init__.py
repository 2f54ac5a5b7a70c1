"""Defines the words for what happened to a run: response, hazard and cue. Needs no JAX.

A run is compared with its *golden run*: the same operator, robot and random numbers without the
fault.

**Response**: what the robot's own checks did beyond what they do in the golden run. A check counts
if it tripped more often or sooner than in the golden run.

- `stopped`: a check stopped the robot.
- `flagged`: a check raised an alarm, and the robot went on.
- `limited`: a check changed a command or dropped a packet, without an alarm.
- `silent`: no check did anything.

Checks that the user adds count by what they do (`[[check]] acts`). A check that only watches does
not count. The response of the built-in checks alone is in `built_in_response` and
`built_in_told_ms`. These columns also exist for campaigns with a detector that may stop the robot.
If an added part changed the course of a run, they count only what the built-in checks did before
the change, because a stop makes built-in checks trip too.

**Hazard**: what became of the motion, the gravest first (`verdict`). `LIMIT_MM` is the limit, a
campaign's `[outcomes] limit_mm`.

- `unintended motion`: while the robot was live, its true tip was farther than the limit from three
  places: from the golden run, from the nominal model, and from where standing still would have
  left it.
- `loss of motion`, first case: the robot was live and did not follow. Its tip was farther than the
  limit from golden run and nominal model, but near where standing still would have left it. Second
  case: the robot was not live for `HALT_MS` longer than in the golden run, although the operator
  held its dead-man switch down and no check had stopped it.
- `false report`: the reported tip was farther than the limit from the true one, beyond what the
  golden run shows.
- `none`.

Each robot defines when it is *live* (`Robot.live`). Motion of the tip while the robot is not live
(it coasts, or drops) is in the column `unintended_off_mm` and decides no hazard.

**Cue**: the haptic cue came, and it had not come in the golden run by then.

**Overloaded cable**: the tension of a cable exceeded its strength, and no cable of the golden run
was overloaded by then. This is not a hazard; the hazards say whether the tip moved. It is known
only if the mechanics have real tensions.

A run has **failed** if a number of the robot, of its nominal model or of its observers is no
longer finite (`ravenjax.vocabulary.failures`). It has no verdict and is in no rate.

A run **evades** the checks if no check raised an alarm or stopped the robot (silent or limited) and
its hazard is unintended motion. It **evades the built-in checks** if none of the built-in checks
raised an alarm or stopped the robot, whatever added checks and detectors did.

    response                 hazard                      cue
    stopped ---------------> unintended motion --------> cue
    flagged ---------------> loss of motion -----------> no cue
    limited  \\ without      false report
    silent   /  an alarm     none
"""
