"""Recorded operators: how to drive a campaign with hands that were recorded.

A recording holds where the surgeon wanted the instrument's tip, as a table (Parquet, CSV) or as an
MCAP file:

    [operator]
    file = "hands.csv"            # from the campaign file's folder
    window_s = [18.2, 47.9]       # a part of it, s from its first row; without it: from its first row

`ravenjax motion hands.csv` shows what the file holds, what becomes of it and which parts the arm
can reach, and draws it before and after; `--campaign FILE` with the options of a campaign.
`ravenjax run` says the same before it computes, manifest.json keeps it under "operator", and the
report shows it. Whatever changes a recording has a key in [operator], and is said; what no key
allows is refused, with row and time, and with what to write instead.

Columns. The suffix alone says the unit; other columns are not read, and named.

    time_s, t_ms, stamp_us, timestamp_ns   when each row was sampled (time, t, stamp, timestamp; s, ms, us, ns)
    gold_x_um, gold_y_um, gold_z_um        desired tip in frame 0 of the arm, m, mm or um; green_ for the other arm
    gold_qx, gold_qy, gold_qz, gold_qw     tip orientation in frame 0; without it as after homing, all the time
    gold_grasp_rad                         jaw opening, rad, mrad or deg, positive opens; without it as after homing
    surgeon_mode                           1 pedal down, 0 up; without it down from 0.2 s on

A Parquet file with a column `packet` is a recorded stream of a console's ITP packets, `arrival_us`
(or _s, _ms, _ns) says when each came: the tip begins as after homing and makes their increments.
`console = "dv_trainer"` names the profile by which they are read (`docs/how-to/consoles.md`);
without it the packets decide. A capture of the network (.pcap, .pcapng) is such a stream, too.

MCAP files have geometry_msgs/PoseStamped on /arm1/setpoint_cp, else measured_cp (arm1 is gold, arm2
green), and for the jaws sensor_msgs/JointState on /arm1/setpoint_js, else measured_js, as `ravenjax
trace` writes them.

A bag of ROS 1 (.bag) or ROS 2 (.db3) has the same topics.

Time. Samples are taken at their own stamps and interpolated to 1 000 a second, so uneven stamps are
no harm. A gap of more than `max_gap_s` (0.1 s) is refused; `max_gap_s = 0.5` bridges longer ones.
Stamps that stand still or go back are refused, and so are stamps in bursts: they say when rows
arrived, not when they were sampled. A file without a time column, or with stamps of arrival, is
even at the rate that the campaign states: `rate_hz = 1000` makes a row a millisecond.

Filter. None, so tremor stays. `cutoff_hz = 5` removes what is faster by a low-pass without phase;
how much that was is said. A tip that jumps (more than 1 mm, faster than 0.5 m/s) is refused with
its row; `spikes = "remove"` interpolates over samples that come back at once, `spikes = "replay"`
plays what was recorded.

Reach. At `scale` as [operator] has it the tip moves as recorded, whatever the scale; hands move 1 /
scale as far. Where a campaign varies the parameter `operator.scale`, the tip moves in proportion.
What is replayed must lie inside the joint limits of the campaign, less 1 degree and 2 mm; otherwise
it is refused, with the stretches that do.

Length. Hands rest for 0.5 s, get up to speed within 0.5 s, then move as recorded. A recording that
ends before the campaign is refused; `at_end = "hold"` lets the hands slow down and rest, `at_end =
"reverse"` plays it backwards and forwards again, `slow_down = 2` takes twice the time.
"""  # noqa: E501
