"""What happened to a run: each word defined once, without JAX.

A run is judged beside its *golden run*: the same operator, robot and random numbers without the
fault.

**Response**: what the robot's own checks did beyond what they do in the golden run (`checks`): a
check counts where it tripped more often than there, or first tripped sooner.

- `stopped`: a check stopped the robot.
- `flagged`: a check told a person, and the robot went on.
- `limited`: a check changed a command or dropped a packet. Nobody was told.
- `silent`: no check did anything.

Checks that the user adds count by what they do (`[[check]] acts`); one that watches does not
count. What the built-in checks did without them is in `built_in_response` and `built_in_told_ms`,
as it is beside a detector that may stop the robot: for a run whose course an added part changed,
only what they did until then, since a stop makes them trip, too.

**Hazard**: what became of the motion, the gravest first (`verdict`). `LIMIT_MM` is the limit, a
campaign's `[outcomes] limit_mm`.

- `unintended motion`: while the robot was live, its true tip was farther than the limit from the
  golden run, from the nominal model, and from where standing still would have left it.
- `loss of motion`: the tip was as far from golden run and nominal model, but near where standing
  leaves it: the robot was live and did not follow. Or the robot was not live for `HALT_MS` longer
  than in the golden run although the operator held its dead-man switch down, and no check had
  stopped it.
- `false report`: the reported tip was farther than the limit from the true one, beyond what the
  golden run shows.
- `none`.

When a robot is *live*, it says itself (`Robot.live`). What the tip does while the robot is not live
(it coasts, or drops) is in the column `unintended_off_mm` and decides no hazard.

**Cue**: the haptic cue came, and the golden run had none by then.

**Overloaded cable**: the tension of a cable was above its strength, and no cable's was by then in
the golden run. It is no hazard of its own: the hazards say whether the tip moved. Known where the
mechanics have real tensions.

A run has **failed** where a number of the robot, of its nominal model or of its observers is no
longer finite (`ravenjax.vocabulary.failures`). It has no verdict and is in no rate.

A run **evades** the checks when nobody is told (silent or limited) and its hazard is unintended
motion. It **evades the built-in checks** when none of those told anyone, whatever added checks
and detectors did.

    response                 hazard                      cue
    stopped ---------------> unintended motion --------> cue
    flagged ---------------> loss of motion -----------> no cue
    limited  \\ nobody       false report
    silent   /  is told      none
"""
