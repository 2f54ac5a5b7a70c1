"""An ITP console written from the protocol's description alone: raven2
`include/itp_teleoperation.h`, packed, little-endian, UDP. It shares no code with the package."""

import socket
import struct

import waiting

IDENTITY = (0.0, 0.0, 0.0, 1.0)
STILL = (0, 0, 0)


def datagram(
    sequence,
    gold=STILL,
    green=STILL,
    quats=(IDENTITY, IDENTITY),
    grasp=(0, 0),
    surgeon_mode=1,
    pactyp=0,
    version=0,
):
    """u_struct: increments (um) and quaternions (x, y, z, w) of the gold and the green arm; 124
    bytes.
    """
    parts = [struct.pack("<III", sequence, pactyp, version)]
    parts += [struct.pack("<ii", gold[axis], green[axis]) for axis in range(3)]
    parts += [struct.pack("<dd", quats[0][i], quats[1][i]) for i in range(4)]
    parts += [struct.pack("<ii", 0, 0), struct.pack("<ii", *grasp)]
    checksum = surgeon_mode + sum(gold) + sum(green) + sequence
    parts.append(struct.pack("<iI", surgeon_mode, checksum & 0xFFFFFFFF))
    whole = b"".join(parts)
    assert len(whole) == 124
    return whole


def force(packet):
    """v_struct: what came back, 52 bytes."""
    assert len(packet) == 52
    forces = [f"f{axis}{arm}" for axis in "xyz" for arm in (0, 1)]
    names = [*["sequence", "last_sequence", "pactyp", "version"], *forces]
    names += ["runlevel", "jointflags", "checksum"]
    fields = dict(zip(names, struct.unpack("<IIIIiiiiiiiIi", packet), strict=True))
    fields["gold"] = tuple(fields.pop(f"f{axis}0") for axis in "xyz")
    fields["green"] = tuple(fields.pop(f"f{axis}1") for axis in "xyz")
    return fields


class Clock:
    """Nanoseconds, as far as a test has set `ms`."""

    ms = 1000.0

    def __call__(self):
        return round(self.ms * 1e6)


class Console:
    """A console with its own port; numbers its packets from 1."""

    def __init__(self, address):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(waiting.DEADLINE_S)
        self.address = address
        self.sequence = 0

    def send(self, **fields):
        """The next packet."""
        self.sequence += 1
        self.send_bytes(datagram(self.sequence, **fields))

    def send_bytes(self, content):
        self.socket.sendto(content, self.address)

    def force(self):
        """The next force packet that came."""
        return force(self.socket.recv(2048))

    def drain(self):
        """Forget the force packets that came so far."""
        self.socket.setblocking(False)
        try:
            while True:
                self.socket.recv(2048)
        except BlockingIOError:
            self.socket.settimeout(waiting.DEADLINE_S)

    def close(self):
        self.socket.close()
