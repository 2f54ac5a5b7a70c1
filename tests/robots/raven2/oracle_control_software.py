"""A second writing of the Raven-II control loop in the original's manner: statics, arrays, its
order of statements.

Shares no code with the package. `float32` is what the original declares float; Python floats are
its doubles. Eight slots per mechanism, slot 3 not connected. Written from the published sources'
rules (raven2 src/raven; the 2015 simulator fork where `fork`), kinematics by 4x4 matrices, no
attempt at speed.
"""

import math
import struct

from numpy import float32
from oracle_kinematics import (
    DEG,
    GOLD,
    GREEN,
    apply,
    forward,
    inverse,
    invert,
    invert_matrix,
    joint_to_theta,
    links,
    matrix_of,
    multiply,
    product,
    quaternion_of,
    rotate,
    select,
    theta_to_joint,
)

SH, EL, ZI, NC, RO, WR, G1, G2 = range(8)
USED = (SH, EL, ZI, RO, WR, G1, G2)

GP42, GP32 = 49.0 / 4.0, 26.0 / 7.0
TOOL_TR = 10.905 / 5.005 * GP32
TR_DOUBLE = [63.095 / 5.675 * GP42, 41.445 / 6.195 * 8.415 / 5.675 * GP42, GP42 / 0.005675, 0.0]
TR_DOUBLE += [TOOL_TR * 120 / 180, TOOL_TR * 200 / 180, TOOL_TR * 100 / 90, TOOL_TR * 100 / 90]
TR = [float32(t) for t in TR_DOUBLE]
GB = (12.25 / (26.0 / 7.0)) * (5.005 / 5.675)
C01, C02, C12 = float32(0.14545), float32(0.0077973826), float32(0.008077387)
PI_F = float32(math.pi)
MS = float32(0.001)

STYLE = {
    "r_grasper": "raven",
    "r_grasper_A": "raven",
    "r_grasper_B": "raven",
    "r_sq_grasper": "square",
}
KAPPA = {
    "large_needle": 0.5,
    "micro_forceps": 0.5,
    "bipolar_forceps": 0.64,
    "cardiere_forceps": 0.7,
}
LIMITS = {  # roll, wrist, jaw 1 (deg)
    "r_grasper": (182, 70, 105),
    "r_grasper_B": (182, 75, 85),
    "r_sq_grasper": (182, 75, 85),
    "large_needle": (220, 75, 85),
    "bipolar_forceps": (182, 65, 85),
}


def c_int(x) -> int:
    """(int)x on x86."""
    x = float(x)
    if (
        x != x
        or not -2147483648.0 <= math.trunc(x if abs(x) != math.inf else 1e300) <= 2147483647.0
    ):
        return -2147483648
    return math.trunc(x)


def wrap32(i: int) -> int:
    return (i + 2**31) % 2**32 - 2**31


ITP = {GOLD: [[0, 0, -1], [-1, 0, 0], [0, 1, 0]], GREEN: [[0, 0, -1], [1, 0, 0], [0, -1, 0]]}


class Joint:
    def __init__(self, kind, arm, tool, fork):
        style = STYLE.get(tool, "dv")
        self.type, self.arm = kind, arm
        self.enc_val = 0
        self.enc_offset = 0
        self.mpos = self.mvel = self.jpos = self.jvel = float32(0)
        self.mpos_d = self.mvel_d = self.jpos_d = self.tau_d = self.tau_g = self.integral = float32(
            0
        )
        self.current_cmd = 0
        self.history = None
        positioning = kind <= ZI
        sign = -1.0 if arm == GOLD else 1.0
        self.enc_sign = self.tau_sign = sign
        if not positioning:
            self.enc_sign = {"raven": -1.0, "dv": 1.0, "square": -sign}[style]
            self.tau_sign = {"raven": -1.0, "dv": 1.0, "square": sign}[style]
            if kind == G1 and not fork:
                self.enc_sign, self.tau_sign = -self.enc_sign, -self.tau_sign
        torque, gear, dac = (0.0603, GP42, 2730.0) if positioning else (0.0538, GP32, 5461.0)
        self.tau_per_amp = float32(torque * gear * self.tau_sign)
        self.dac_per_amp = float32(dac)
        jaw = kind in (G1, G2)
        self.kp = float32(
            [0.3, 0.3, 0.15, 0, 0.09, 0.05, 0.05, 0.05][kind] if not (fork and jaw) else 0.02
        )
        self.kd = float32([0.008, 0.008, 0.012 if arm == GOLD else 0.01, 0, 0.001, 0, 0, 0][kind])
        self.ki = float32(0.0 if positioning or (fork and jaw) else 0.05)


class Mechanism:
    def __init__(self, arm, tool, fork):
        self.arm, self.tool = arm, tool
        self.joint = [Joint(k, arm, tool, fork) for k in range(8)]
        self.pos = self.pos_d = [0, 0, 0]
        identity = [[float32(i == j) for j in range(3)] for i in range(3)]
        self.R = self.R_d = identity
        self.grasp = self.grasp_d = 0
        self.pins = 0
        style = STYLE.get(tool, "dv")
        self.s = {"raven": 1, "dv": -1, "square": -1}[style] * (
            1 if arm == GOLD or style == "square" else -1
        )
        self.s6 = self.s if fork else -self.s
        self.kappa = float32(KAPPA.get(tool, 0.0))

    def jaws_yaw(self):
        return float(float32(self.joint[G2].jpos - self.joint[G1].jpos)) / 2

    def six(self):
        return [float(self.joint[k].jpos) for k in (SH, EL, ZI, RO, WR)] + [self.jaws_yaw()]


DAC_MAX = {
    "beginner": [1500, 1500, 1000, 0, 3000, 3000, 3800, 3800],
    "moderate": [2500, 2500, 2000, 0, 3000, 3000, 3800, 3800],
    "advanced": [5000, 5000, 4000, 0, 3000, 3000, 3800, 3800],
    "fork": [10000, 10000, 8000, 0, 6000, 2700, 4800, 4800],
}


class Loop:
    """The process: `network(datagram)` as packets arrive, `cycle(...)` once a millisecond."""

    def __init__(
        self,
        arms,
        tools,
        fork=False,
        policy=1,
        level="moderate",
        plc=True,
        runlevel=0,
        absolute=False,
    ):
        self.fork, self.policy, self.plc, self.absolute = fork, policy, plc, absolute
        self.mech = [Mechanism(arm, tool, fork) for arm, tool in zip(arms, tools, strict=True)]
        self.dac_max = DAC_MAX["fork" if fork else level]
        self.max_inst = 12000 if fork else 20000
        self.runlevel, self.sublevel = runlevel, 3 if runlevel else 0
        self.initialized = runlevel > 0
        self.soft_estopped = False
        self.mismatch = 0
        self.settle = 0
        self.overdrive_count = 0
        self.watchdog = 0
        self.gtime = 0
        self.last_updated = 0
        self.is_updated = False
        self.seq_last = 0
        self.last_sequence, self.surgeon_mode = 111, 0
        self.first_sample = True
        self.pins_out = 0
        home = [30 * DEG, 90 * DEG, 0.4, 0.0, 0.0, 0.0, 45 * DEG, 45 * DEG]
        home = home[:3] + [0.0, 0.0, 0.0, 45 * DEG, 45 * DEG]
        for m in self.mech:
            for k in USED:
                m.joint[k].jpos = m.joint[k].jpos_d = float32(home[k])
            self.measure(m)
            m.pos_d, m.R_d, m.grasp_d = m.pos, m.R, m.grasp
        self.x_acc = [list(m.pos_d) for m in self.mech]
        self.r_acc = [m.R_d for m in self.mech]
        self.q_acc = [quaternion_of([[float(e) for e in row] for row in m.R_d]) for m in self.mech]
        self.grasp_acc = [m.grasp_d for m in self.mech]

    # --- network thread ---

    def network(self, data: bytes):
        if len(data) < 124:
            return
        seq = struct.unpack_from("<I", data, 0)[0]
        if seq == 0:
            return
        if seq > (self.seq_last + 1) % 2**32:
            self.seq_last = seq
            return
        if seq == self.seq_last:
            return
        if seq == (self.seq_last + 1) % 2**32:
            self.seq_last = seq
            self.teleop(seq, data)
            return
        if self.seq_last > 1000 and seq < self.seq_last - 1000:
            self.seq_last = seq

    def teleop(self, seq, data):
        for i, m in enumerate(self.mech):
            arm = m.arm
            p = [struct.unpack_from("<i", data, 12 + 8 * k + 4 * arm)[0] for k in range(3)]
            q = [struct.unpack_from("<d", data, 36 + 16 * k + 8 * arm)[0] for k in range(4)]
            grasp = struct.unpack_from("<i", data, 108 + 4 * arm)[0]
            if self.absolute:
                self.x_acc[i] = p
                self.r_acc[i] = [[float32(e) for e in row] for row in matrix_of(q)]
                self.grasp_acc[i] = grasp
                continue
            c = ([[float(e) for e in row] for row in ITP[arm]], [0.0, 0.0, 0.0])
            r, p = multiply(multiply(c, (matrix_of(q), [float(e) for e in p])), invert(c))
            self.x_acc[i] = [wrap32(a + c_int(b)) for a, b in zip(self.x_acc[i], p, strict=True)]
            self.q_acc[i] = product(quaternion_of(r), self.q_acc[i])
            self.r_acc[i] = [[float32(e) for e in row] for row in matrix_of(self.q_acc[i])]
            g = wrap32(self.grasp_acc[i] - (2 if self.fork else 1) * grasp)
            self.grasp_acc[i] = max(min(g, 1570), -523 if self.fork else -174)
        self.surgeon_mode = struct.unpack_from("<i", data, 116)[0]
        self.last_sequence = seq
        self.is_updated = True

    # --- local_io ---

    def check_updates(self):
        if self.is_updated or self.last_updated == 0:
            self.last_updated = self.gtime
        elif self.gtime - self.last_updated > 5000 and self.surgeon_mode:
            self.surgeon_mode = 0
            self.last_updated = self.gtime
            self.is_updated = True
        return self.is_updated

    def reset_origin(self):
        for i, m in enumerate(self.mech):
            self.x_acc[i] = list(m.pos_d)
            if abs(self.grasp_acc[i] - m.grasp_d) / 1000.0 > 45 * DEG:
                self.grasp_acc[i] = m.grasp_d
            self.r_acc[i] = m.R_d
            self.q_acc[i] = quaternion_of([[float(e) for e in row] for row in m.R_d])
        self.is_updated = True

    # --- the cycle ---

    def cycle(self, enc, pins, read_ok):
        self.gtime += 1
        for m, counts, byte, ok in zip(self.mech, enc, pins, read_ok, strict=True):
            if ok:
                for k, count in zip(USED, counts, strict=True):
                    m.joint[k].enc_val = count
                m.pins = byte
        self.state_machine()
        if self.check_updates():
            self.is_updated = False
            if self.runlevel == 3:
                for i, m in enumerate(self.mech):
                    m.pos_d, m.R_d, m.grasp_d = (
                        list(self.x_acc[i]),
                        self.r_acc[i],
                        self.grasp_acc[i],
                    )
        if self.plc:
            for m in self.mech:
                for j in m.joint:
                    j.current_cmd = 0
        self.control_raven()
        if self.overdrive_detect():
            self.soft_estopped = True
        self.outputs()
        return [[m.joint[k].current_cmd for k in USED] for m in self.mech], self.pins_out

    def state_machine(self):
        if not self.plc:
            return
        desired = min((m.pins >> 6) & 3 for m in self.mech)
        if desired == self.runlevel:
            return
        self.mismatch += 1
        if self.mismatch < 4:
            return
        self.mismatch = 0
        self.runlevel = desired
        if desired == 0:
            self.soft_estopped = False
            self.initialized = False
            self.sublevel = 0

    def set_start_pose(self):
        for m in self.mech:
            m.pos_d, m.R_d, m.grasp_d = list(m.pos), m.R, m.grasp
        self.reset_origin()

    def init_robot(self):
        if self.runlevel == 0:
            self.initialized = False
        if self.runlevel != 1:
            return
        if self.sublevel == 0:
            self.sublevel = 1
            if not self.fork:
                return
        if self.sublevel == 1:
            if not self.initialized:
                self.set_start_pose()
            self.sublevel = 2
        elif self.sublevel == 2:
            self.set_start_pose()
            self.settle += 1
            if self.settle == 11:
                self.settle = 0
                self.sublevel = 3
        elif self.sublevel == 3:
            self.initialized = True

    def measure(self, m):
        r, p = forward(m.arm, m.six())
        m.pos = [c_int(x * 1e6) for x in p]
        m.R = [[float32(e) for e in row] for row in r]
        m.grasp = c_int(float32(float32(m.joint[G1].jpos + m.joint[G2].jpos) * float32(1000.0)))

    def estimate(self, j):
        value = float32(j.enc_val)
        if j.enc_sign < 0:
            value = -value
        angle = float32(2.0 * float(PI_F) * (1.0 / 4000.0) * float(value - float32(j.enc_offset)))
        if j.history is None:
            j.history = [[angle] * 3, [angle] * 3]
        x, y = j.history
        if not self.fork:
            j.mpos, j.mvel = angle, (angle - x[0]) / MS
            j.history = [[angle, *x[:2]], y]
            return
        new = angle * float32(0.02864)
        for gain, old in zip(
            (0.08591, 0.08591, 0.02864, 1.5189, -0.96, 0.2120), (*x, *y), strict=True
        ):
            new = new + old * float32(gain)
        j.mpos, j.mvel = new, (new - y[0]) / MS
        j.history = [[angle, *x[:2]], [new, *y[:2]]]

    def forward_coupling(self, m):
        q = m.joint

        def per(k):
            return 1.0 / float(TR[k])

        q[SH].jpos = float32(per(SH) * float(q[SH].mpos))
        q[EL].jpos = float32(per(EL) * float(q[EL].mpos) - float(C01 * q[SH].jpos))
        z = per(ZI) * float(q[ZI].mpos) - float(C02 * q[SH].jpos) - float(C12 * q[EL].jpos)
        q[ZI].jpos = float32(z)
        share = float(q[ZI].mpos) / GB
        q[RO].jpos = float32(per(RO) * (float(q[RO].mpos) - m.s * share))
        q[WR].jpos = float32(per(WR) * (float(q[WR].mpos) - m.s * share))
        bend = float(m.kappa * q[WR].jpos)
        q[G1].jpos = float32(per(G1) * (float(q[G1].mpos) - m.s6 * share) - bend)
        q[G2].jpos = float32(per(G2) * (float(q[G2].mpos) - m.s * share) + bend)

    def inverse_coupling(self, m):
        q = m.joint
        q[SH].mpos_d = TR[SH] * q[SH].jpos_d
        q[EL].mpos_d = TR[EL] * (q[EL].jpos_d + C01 * q[SH].jpos_d)
        q[ZI].mpos_d = TR[ZI] * (q[ZI].jpos_d + C02 * q[SH].jpos_d + C12 * q[EL].jpos_d)
        share = float(q[ZI].mpos) / GB
        bend = m.kappa * q[WR].jpos_d
        for k, value, s in (
            (RO, q[RO].jpos_d, m.s),
            (WR, q[WR].jpos_d, m.s),
            (G1, q[G1].jpos_d + bend, m.s6),
            (G2, q[G2].jpos_d - bend, m.s),
        ):
            q[k].mpos_d = float32(float(TR[k] * value) + s * share)

    def joint_limits(self, js):
        roll, wrist, jaw = LIMITS[self.mech[0].tool]
        if self.fork:
            roll = 150
        low = [0.0, 45.0, None, -roll, -wrist]
        high = [90.0, 135.0, None, roll, wrist]
        limited = False
        for k in range(5):
            lo, hi = (0.23, 0.56) if k == 2 else (low[k] * DEG, high[k] * DEG)
            if not (self.fork and k == 3):  # the fork's roll limit is a literal, not a stored float
                lo, hi = float(float32(lo)), float(float32(hi))
            if js[k] <= lo:
                js[k], limited = lo, True
            elif js[k] >= hi:
                js[k], limited = hi, True
        floor = float(float32(-jaw * DEG))
        if not self.fork and js[5] <= floor:
            js[5], limited = floor, True
        return limited

    def inverse_kinematics(self):
        for m in self.mech:
            pose = ([[float(e) for e in row] for row in m.R_d], [x / 1e6 for x in m.pos_d])
            solutions, _ = inverse(m.arm, pose)
            th = select(solutions, joint_to_theta(m.arm, m.six()))
            if th is None:
                return
            js = theta_to_joint(m.arm, th)
            opening = m.grasp_d / 1000.0
            jaws = (-js[5] + opening / 2, js[5] + opening / 2)
            if self.joint_limits(js):
                r, p = forward(m.arm, js)
                m.pos_d = [c_int(x * 1e6) for x in p]
                m.R_d = [[float32(e) for e in row] for row in r]
                self.reset_origin()
            for k, value in zip(USED, (*js[:5], *jaws), strict=True):
                m.joint[k].jpos_d = float32(value)

    def gravity(self, m):
        gold = m.arm == GOLD
        parts = links(m.arm, joint_to_theta(m.arm, m.six()))
        mass = (0.494, 0.750, 0.231)
        sign = 1.0 if gold else -1.0
        com1, com2 = (
            [sign * 0.0065, sign * 0.09775, -sign * 0.13771],
            [-0.002, -0.18274, -sign * 0.23053],
        )
        g = [-float(float32(9.8)), 0.0, 0.0]
        gs = []
        for r, _ in parts[:3]:
            g = rotate(invert_matrix(r), g)
            gs.append(g)
        com3_2 = apply(parts[2], [0.0, 0.0, 0.0])
        com2_1, com3_1 = apply(parts[1], com2), apply(parts[1], com3_2)

        def about_z(com, g):
            return com[0] * g[1] - com[1] * g[0]

        t1 = -sum(
            about_z(c, [w * x for x in gs[0]])
            for c, w in zip((com1, com2_1, com3_1), mass, strict=True)
        )
        t2 = -sum(
            about_z(c, [w * x for x in gs[1]])
            for c, w in zip((com2, com3_2), mass[1:], strict=True)
        )
        f3 = -mass[2] * gs[2][2]
        for k, effort in zip((SH, EL, ZI), (t1, t2, f3), strict=True):
            m.joint[k].tau_g = float32(effort / float(TR[k]) * GP42)

    def control_raven(self):
        self.init_robot()
        for m in self.mech:
            for k in USED:
                self.estimate(m.joint[k])
            self.forward_coupling(m)
            for k in (SH, EL, ZI):
                m.joint[k].jvel = m.joint[k].mvel / TR[k]
        for m in self.mech:
            self.measure(m)
            if self.runlevel not in (1, 3):
                m.pos_d, m.R_d, m.grasp_d = list(m.pos), m.R, m.grasp
        if self.runlevel not in (1, 3):
            self.reset_origin()
        if self.runlevel < 2:
            return
        if self.runlevel == 2:
            for m in self.mech:
                m.pos_d = list(m.pos)
            self.reset_origin()
        self.inverse_kinematics()
        for m in self.mech:
            self.inverse_coupling(m)
            for k in USED:
                j = m.joint[k]
                if self.runlevel != 3:
                    j.tau_d = float32(0)
                    continue
                error = j.mpos_d - j.mpos
                j.integral = j.integral + error * MS
                j.tau_d = j.kp * error + j.kd * (j.mvel_d - j.mvel) + j.ki * j.integral
            if not self.fork:
                self.gravity(m)
            for k in USED:
                j = m.joint[k]
                j.tau_d = j.tau_d + j.tau_g
        for m in self.mech:
            for k in USED:
                j = m.joint[k]
                value = c_int(j.tau_d * (float32(1.0) / j.tau_per_amp) * j.dac_per_amp)
                j.current_cmd = 0 if self.soft_estopped else max(-32768, min(32767, value))

    def overdrive_detect(self):
        tripped = False
        for m in self.mech:
            for k in range(7):
                j = m.joint[k]
                size, limit = abs(j.current_cmd), self.dac_max[k]
                if size > self.max_inst:
                    j.current_cmd = 0
                    self.overdrive_count = 0
                    tripped = True
                elif size > limit and (self.fork or self.runlevel >= 1):
                    if self.fork or self.policy == 1:
                        j.current_cmd = limit if j.current_cmd > 0 else -limit
                        self.overdrive_count = 0
                    elif self.policy == 0:
                        self.overdrive_count = 0
                    else:
                        if self.overdrive_count > 10:
                            j.current_cmd = 0
                            tripped = True
                            self.overdrive_count = 0
                        self.overdrive_count += 1
        return tripped

    def outputs(self):
        pins = self.runlevel & 3
        if self.runlevel > 1 and self.surgeon_mode:
            pins |= 4
        if self.initialized:
            pins |= 8
        if not self.soft_estopped:
            if self.watchdog <= 25:
                pins |= 16
            elif self.watchdog >= 50:
                self.watchdog = 0
        self.watchdog += 1
        self.pins_out = pins
