"""Our LCM buses in Python, with what the standard library has: messages of one datagram (all but large maps).

Types: lcm-gen -p --ppath DIRECTORY lcmtypes/*.lcm, and DIRECTORY on PYTHONPATH.
"""

import re
import socket
import struct
import time
import zlib

from sogm_swarm import header_t

MAGIC = 0x4C433032  # "LC02", a message in one datagram


def utime():
    """Microseconds since the epoch."""
    return time.time_ns() // 1000


class Bus:
    """A bus by its URL, udpm://ADDRESS:PORT?ttl=N; `robot` is whom its messages are from or about."""

    def __init__(self, url, robot=0):
        group, port, ttl = re.fullmatch(r"udpm://([0-9.]+):(\d+)\?ttl=(\d+)", url).groups()
        self.address = (group, int(port))
        self.robot, self.boot, self.seq = robot, int(20 * time.clock_gettime(time.CLOCK_BOOTTIME)), {}
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, int(ttl))
        self.socket.bind(("", int(port)))
        membership = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton("0.0.0.0"))
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)

    def publish(self, channel, message):
        """Fills the header, seals the bytes (CRC-32 of all after it, at byte 8) and sends them."""
        seq = self.seq[channel] = self.seq.get(channel, -1) + 1
        message.header = header_t()
        message.header.schema_version = header_t.kSchemaVersion
        message.header.robot_id, message.header.boot = self.robot, self.boot
        message.header.seq, message.header.utime = seq, utime()
        data = bytearray(message.encode())
        data[8:12] = struct.pack(">I", zlib.crc32(data[12:]))
        self.socket.sendto(struct.pack(">II", MAGIC, seq) + channel.encode() + b"\0" + data, self.address)

    def receive(self, channel, message_type):
        """The next message of a channel; damaged ones are passed over."""
        while True:
            packet = self.socket.recv(65536)
            name, _, data = packet[8:].partition(b"\0")
            if packet[:4] != struct.pack(">I", MAGIC) or name != channel.encode() or len(data) < 36:
                continue
            if struct.unpack(">I", data[8:12])[0] != zlib.crc32(data[12:]):
                continue
            try:
                return message_type.decode(data)
            except (ValueError, struct.error):  # another version of the type
                continue
