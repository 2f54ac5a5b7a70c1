"""Finds a small set of checks that would have detected the faults that evade a robot's checks, and
its rate of false alarms.

1. `observation` runs fault-free motion of other operators, in three shares. The first gives the
*scales* of candidates, with the second the set's margin is *calibrated*, and on the third its false
alarms are *stated*.

2. It runs the campaign once, with every candidate at every margin as a detector. Half of the
faults *select* the set, and the other half *states* its coverage.

3. `promise` selects the greedy set, its margin, its false alarms and its coverage, and compares
other sets.

4. `finding` runs all steps in order, and the set as real detectors in a separate run.

5. `output` writes table, sentences and figure, and the set as a campaign with user-defined
detectors.
"""
