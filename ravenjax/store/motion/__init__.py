"""Recorded operators: drives a campaign with recorded hand motion.

A recording holds the desired poses of the instrument's tip, as a table (Parquet, CSV or other text)
or a bag. A campaign names it.

    [operator]
    file = "hands.csv"            # relative to the campaign file's folder
    window_s = [18.2, 47.9]       # part of it, s from its first row. Default: from its first row.

`ravenjax motion hands.csv` shows the content of the file, the motion made from it and the parts
that the arm can reach. It draws the recording and the motion. `--campaign FILE` uses the options of
a campaign. `ravenjax run` prints the same before it computes, manifest.json keeps it under
"operator", and the report shows it. Every change of a recording has a key in [operator] and is
reported. A recording that needs a change that no key allows is refused. The message names the row
and the time, and what to write instead.

Columns. Only the suffix gives the unit. Other columns are not read, but are named in the output.
`columns` maps the names of a file to these, or names all columns of a file without a header line.
`sensors` selects each arm's rows by a column that names sensors.

    time_s, t_ms, stamp_us,            when each row was sampled (time, t, stamp, timestamp;
        timestamp_ns                   s, ms, us, ns)
    gold_x_um, gold_y_um, gold_z_um    desired tip in frame 0 of the arm, m, mm or um; green_ for
                                       the other arm
    gold_qx, gold_qy, gold_qz,         tip orientation in frame 0, or gold_r11, gold_r12 to
        gold_qw                        gold_r33; default: constant, as after homing
    gold_grasp_rad                     jaw opening, rad, mrad or deg, positive opens; default: as
                                       after homing
    surgeon_mode                       1 pedal down, 0 up; default: down from 0.2 s on.

Frames. Positions are in frame 0 of their arm, unless a bag's header names CRTK's base frame.
`frame`, `rotation` and `offset_mm` state another frame. `place = "home"` moves and turns the motion
so that it begins as after homing.

A Parquet file with a column `packet` is a recorded stream of a console's ITP packets. `arrival_us`
(or _s, _ms, _ns) is the time at which each arrived. The tip begins as after homing and makes the
packets' increments. `console = "dv_trainer"` names the profile with which they are read
(`docs/how-to/consoles.md`); by default the packets decide. A network capture (.pcap, .pcapng) is
also such a stream.

MCAP files and bags of ROS 1 (.bag) and ROS 2 (.db3) have geometry_msgs/PoseStamped on
/arm1/setpoint_cp, else measured_cp (arm1 is gold, arm2 green), in any namespace. `topics` names
others. The jaws are read from sensor_msgs/JointState: either their opening on jaw/setpoint_js, or
the joints grasp1 and grasp2 on setpoint_js, as `ravenjax trace` writes them. Topics with `measured`
in place of `setpoint` are read too.

Time. Samples are taken at their stamps and interpolated to 1 000 per second, so uneven stamps do no
harm. A gap of more than `max_gap_s` (0.1 s) is refused; `max_gap_s = 0.5` bridges longer ones.
Stamps that stand still or go back are refused. So are stamps in bursts, because they are times of
arrival, not of sampling. A file without a time column, or with stamps of arrival, needs a sampling
rate in the campaign: `rate_hz = 1000` means one row per millisecond.

Filter. By default tremor stays. `cutoff_hz = 5` removes faster motion with a low-pass filter
without phase shift; the amount is reported. A tip that jumps (more than 1 mm, faster than 0.5 m/s)
is refused with its row. `spikes = "remove"` interpolates over a jump from which the tip returns at
once, and `spikes = "replay"` plays what was recorded.

Reach. `scale` in [operator] does not change the motion of the tip, which is as recorded. The hands
move 1 / scale times as far. If a campaign varies the parameter `operator.scale`, the tip moves in
proportion. The replayed part must lie inside the joint limits of the campaign, less 1 degree and 2
mm. Otherwise it is refused, and the message lists the stretches that do.

Length. Hands rest for 0.5 s, accelerate within 0.5 s, then move as recorded. A recording that ends
before the campaign is refused. `at_end = "hold"` lets the hands slow down and rest, `at_end =
"reverse"` plays it backwards and forwards again, and `slow_down = 2` takes twice the time.
"""
