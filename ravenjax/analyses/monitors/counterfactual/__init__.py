"""Finds a small set of additional checks that would detect faults that evade a robot's checks.

The faults and the fault-free motions are divided into shares, so that no data serve two purposes.

1. `observation` runs fault-free motions of other operators. The *scale* of a check is its largest
   value in the first share of the motions. The second share serves to choose a *margin*, and the
   third to measure false alarms. A check raises an alarm above its scale times the margin.
2. `observation` then runs the campaign with every candidate check as a detector, at each margin of
   a list. Half of the faults serve to select the set, and the other half to measure its coverage.
3. `check_set` selects a set greedily. The margin of the set is the smallest one that keeps the
   requested false-alarm rate. The set's false alarms and coverage are compared with other sets.
4. `finding` runs all steps in order. It then runs the campaign again with the set as detectors.
5. `output` writes a table, sentences, a figure, and a campaign whose detectors are the set.
"""
