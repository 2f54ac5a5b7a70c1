"""Finds a small set of additional checks that would detect faults that evade a robot's checks.

The faults and the fault-free motions are divided into shares, so that no data serve two purposes.

1. `observation` runs fault-free motions of other operators. A check raises an alarm above its scale
   times the margin of the set. The first share of the motions gives the *scales*, the largest
   values; the second gives the *margin*. The third share measures the set's false-alarm rate.
2. `observation` then runs the campaign, with every candidate at every margin as a detector. Half of
   the faults *select* the set. The other half measures the set's coverage.
3. `check_set` selects a set greedily, computes its margin, false alarms and coverage, and compares
   the set with other sets.
4. `finding` runs all steps in order. It then runs the campaign again with the set as detectors.
5. `output` writes a table, sentences, a figure, and a campaign whose detectors are the set.
"""
