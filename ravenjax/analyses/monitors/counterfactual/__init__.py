"""What would have helped: which few checks would have seen the faults that evade a robot's own, and
at what price.

1. `motions`: fault-free motion, of other operators, in three shares: of one come the *scales* of candidates, with one
   the set's margin is *calibrated*, of one its false alarms are *stated*.
2. `hazards`: the campaign's runs, once, with every candidate at every margin as a detector. Of half of the faults the
   set is *selected*, of the other half its coverage is *stated*.
3. `cover`: the greedy set. `promise`: its margin, its false alarms, what it covers, and what other sets do.
4. `output`: table, figure, and the set as a campaign with detectors of one's own.
"""  # noqa: E501
