"""Finds a small set of checks that would have detected the faults that evade a robot's checks, and
its rate of false alarms.

1. `observation` runs fault-free motions of other operators, in three shares. The first share gives
   the *scales* of the candidates. The second share *calibrates* the set's margin. False alarms on
   the third share are *stated* as the result.
2. `observation` then runs the campaign once, with every candidate at every margin as a detector.
   Half of the faults *select* the set. The other half *states* the set's coverage.
3. `promise` selects a set greedily, states its margin, false alarms and coverage, and compares the
   set with others.
4. `finding` runs all steps in order. It then runs the campaign again with the set as detectors.
5. `output` writes a table, sentences, a figure, and a campaign with the set as user-defined
   detectors.
"""
