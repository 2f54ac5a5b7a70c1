"""Which few checks would have detected the faults that evade a robot's checks, and with how many
false alarms.

1. `motions`: fault-free motion, of other operators, in three shares. From one come the *scales* of
   candidates, with one the set's margin is *calibrated*, of one its false alarms are *stated*.
2. `hazards`: the campaign's runs, once, with every candidate at every margin as a detector. Half of
   the faults *select* the set, the other half *state* its coverage.
3. `promise`: the greedy set, its margin, its false alarms, what it covers, and what other sets do.
4. `finding`: all of it in its order; and the set as real detectors in a run of their own.
5. `output`: table, sentences, figure, and the set as a campaign with detectors of one's own.
"""
