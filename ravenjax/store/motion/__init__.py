"""Recorded operators: drives a campaign with recorded hand motion.

A recording holds the desired poses of the instrument's tip, as a table (Parquet, CSV) or an MCAP
file:

    [operator]
    file = "hands.csv"            # relative to the campaign file's folder
    window_s = [18.2, 47.9]       # part of it, s from its first row; default: from its first row

`ravenjax motion hands.csv` shows the content of the file, the motion made of it and the parts that
the arm can reach, and draws it before and after. `--campaign FILE` uses the options of a campaign.
`ravenjax run` prints the same before it computes, manifest.json keeps it under "operator", and the
report shows it. Every change of a recording has a key in [operator] and is reported. What no key
allows is refused, with row and time, and with what to write instead.

Columns. Only the suffix gives the unit. Other columns are not read, but are named in the output.

    time_s, t_ms, stamp_us,            when each row was sampled (time, t, stamp, timestamp;
        timestamp_ns                   s, ms, us, ns)
    gold_x_um, gold_y_um, gold_z_um    desired tip in frame 0 of the arm, m, mm or um; green_ for
                                       the other arm
    gold_qx, gold_qy, gold_qz,         tip orientation in frame 0; default: constant, as after
        gold_qw                        homing
    gold_grasp_rad                     jaw opening, rad, mrad or deg, positive opens; default: as
                                       after homing
    surgeon_mode                       1 pedal down, 0 up; default: down from 0.2 s on

A Parquet file with a column `packet` is a recorded stream of a console's ITP packets. `arrival_us`
(or _s, _ms, _ns) is the time at which each arrived. The tip begins as after homing and makes the
packets' increments. `console = "dv_trainer"` names the profile with which they are read
(`docs/how-to/consoles.md`); by default the packets decide. A network capture (.pcap, .pcapng) is
also such a stream.

MCAP files have geometry_msgs/PoseStamped on /arm1/setpoint_cp, else measured_cp (arm1 is gold, arm2
green). The jaws are sensor_msgs/JointState on /arm1/setpoint_js, else measured_js, as `ravenjax
trace` writes them. A bag of ROS 1 (.bag) or ROS 2 (.db3) has the same topics.

Time. Samples are taken at their stamps and interpolated to 1 000 per second, so uneven stamps do no
harm. A gap of more than `max_gap_s` (0.1 s) is refused; `max_gap_s = 0.5` bridges longer ones.
Stamps that stand still or go back are refused. So are stamps in bursts, because they are times of
arrival, not of sampling. A file without a time column, or with stamps of arrival, needs a sampling
rate in the campaign: `rate_hz = 1000` means one row per millisecond.

Filter. By default there is none, so tremor stays. `cutoff_hz = 5` removes faster motion with a
low-pass filter without phase shift; the amount is reported. A tip that jumps (more than 1 mm,
faster than 0.5 m/s) is refused with its row. `spikes = "remove"` interpolates over samples that
return at once, and `spikes = "replay"` plays what was recorded.

Reach. With the `scale` of [operator] the tip moves as recorded, whatever the scale; hands move 1 /
scale as far. If a campaign varies the parameter `operator.scale`, the tip moves in proportion. The
replayed part must lie inside the joint limits of the campaign, less 1 degree and 2 mm. Otherwise it
is refused, with the stretches that do.

Length. Hands rest for 0.5 s, accelerate within 0.5 s, then move as recorded. A recording that ends
before the campaign is refused. `at_end = "hold"` lets the hands slow down and rest, `at_end =
"reverse"` plays it backwards and forwards again, and `slow_down = 2` takes twice the time.
"""
