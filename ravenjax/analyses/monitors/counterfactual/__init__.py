"""Finds a small set of additional checks that would detect faults that evade a robot's checks.

A check raises an alarm if its score exceeds a *scale* times a *margin*. The scale is the largest
score of this check in fault-free motion. All checks of a set have the same margin.

1. `observation` simulates fault-free motions of other operators, and the faults of the campaign. A
   quarter of the motions determines the scales, a quarter the margin, and half the false-alarm
   rate. Half of the faults serve to select the set. The other half serve to measure the set's
   coverage: the share of faults that it detects.
2. `check_set` selects the set greedily. The margin of the set is the smallest one that keeps the
   requested false-alarm rate. The set is compared with other sets.
3. `finding` runs these steps, and runs the campaign again with the selected checks as detectors.
4. `output` writes a table, sentences, a figure, and a campaign with the selected checks.
"""
