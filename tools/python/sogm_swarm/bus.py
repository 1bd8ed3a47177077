"""The buses, as LCM's own programs speak them: UDP multicast, one message in one datagram."""

import contextlib
import ctypes
import ipaddress
import re
import socket
import struct
import time

from sogm_swarm import codec, header_t

ONBOARD_URL = "udpm://239.255.76.67:7700?ttl=0"  # of the one robot on its own computer
MAGIC = struct.pack(">I", 0x4C433032)  # "LC02", a message in one datagram
MAX_BYTES = 65499  # of channel, NUL and message
RECEIVE_BUFFER = 2097152

# Of Linux, which Python's socket module does not name.
SO_ATTACH_FILTER = 26
IP_PKTINFO = 8


def utime():
    """Microseconds since the epoch."""
    return time.time_ns() // 1000


def _new_boot():
    """Twentieths of a second since the computer was started; waits for the next one, so that no two are the same."""
    boot = int(20 * time.clock_gettime(time.CLOCK_BOOTTIME)) + 1
    while (left := boot / 20 - time.clock_gettime(time.CLOCK_BOOTTIME)) > 0:
        time.sleep(left)
    return boot


class Bus:
    """A bus by its URL, udpm://ADDRESS:PORT?ttl=N (ValueError, if it is none); `robot` is whom its messages are from or
    about. With ttl=0 nothing is heard but this computer, whatever address a datagram claims to be from."""

    def __init__(self, url=ONBOARD_URL, robot=0):
        parts = re.fullmatch(r"udpm://([0-9.]+):(\d+)\?ttl=(\d+)", url)
        if not parts or not 0 < int(parts[2]) < 65536 or int(parts[3]) > 255:
            raise ValueError(f"bus '{url}': must be udpm://ADDRESS:PORT?ttl=N")
        if not ipaddress.IPv4Address(parts[1]).is_multicast:
            raise ValueError(f"bus '{url}': the address must be within 224.0.0.0 to 239.255.255.255")
        if not 0 <= robot <= 32767:
            raise ValueError(f"robot {robot}: must be within [0, 32767]")
        self.url, self.robot = url, robot
        self.refused = 0  # messages of what was asked for that were damaged, or of another type
        self.boot = _new_boot()
        self._seq = {}  # by channel
        self._address, ttl = (parts[1], int(parts[2])), int(parts[3])
        self._loopback = socket.if_nametoindex("lo") if ttl == 0 else None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        if self._loopback is not None:
            self._hear_this_computer_alone()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, ttl)
        try:
            self._socket.bind(self._address)
        except OSError as error:
            raise ValueError(f"bus '{url}': {error.strerror}") from error
        interfaces = [0] if self._loopback is None else [0, *(index for index, _ in socket.if_nameindex())]
        for interface in interfaces:  # 0: the one that the route leads over
            membership = struct.pack("4s4si", socket.inet_aton(parts[1]), bytes(4), interface)
            with contextlib.suppress(OSError):  # it has no multicast, or is joined already
                self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)

    def publish(self, channel, message):
        """Fills the header and sends the message. ValueError: it is too large."""
        seq = self._seq[channel] = self._seq.get(channel, -1) + 1
        message.header = header_t()
        message.header.schema_version = header_t.kSchemaVersion
        message.header.robot_id, message.header.boot = self.robot, self.boot
        message.header.seq, message.header.utime = seq, utime()
        payload = channel.encode() + b"\0" + codec.encode(message)
        if len(payload) > MAX_BYTES:
            raise ValueError(f"{channel}: {len(payload)} bytes do not fit into one datagram of {MAX_BYTES}")
        datagram = MAGIC + struct.pack(">I", seq & 0xFFFFFFFF) + payload
        try:
            self._socket.sendto(datagram, self._address)
        except OSError:
            if self._loopback is None:
                raise
            over = struct.pack("i4s4s", self._loopback, bytes(4), bytes(4))  # no route leads elsewhere
            self._socket.sendmsg([datagram], [(socket.IPPROTO_IP, IP_PKTINFO, over)], 0, self._address)

    def receive(self, channel, message_type, timeout=None):
        """The next message of a channel, from or about any robot; None after `timeout` seconds without one."""
        heard = self.receive_any({channel: message_type}, timeout)
        return heard and heard[1]

    def receive_any(self, types, timeout=None):
        """The next message of several channels, {channel: type}, with its channel. Bad ones are counted and passed over."""
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            self._socket.settimeout(None if end is None else max(end - time.monotonic(), 1e-6))
            try:
                datagram = self._socket.recv(65536)
            except (TimeoutError, socket.timeout):
                return None
            name, _, data = datagram[8:].partition(b"\0")
            message_type = types.get(name.decode(errors="replace")) if datagram[:4] == MAGIC else None
            if message_type is None:
                continue
            try:
                return name.decode(), codec.decode(data, message_type)
            except codec.Refused:
                self.refused += 1

    def _hear_this_computer_alone(self):
        """A filter in the kernel (classic BPF): what this computer sent, or what came over loopback."""
        load, equal, end = 0x20, 0x15, 0x06
        packet_type, interface, looped = 0xFFFFF004, 0xFFFFF008, 5
        lines = [(load, 0, 0, packet_type), (equal, 0, 1, looped), (end, 0, 0, 0xFFFFFFFF),
                 (load, 0, 0, interface), (equal, 0, 1, self._loopback), (end, 0, 0, 0xFFFFFFFF), (end, 0, 0, 0)]
        code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *line) for line in lines))
        self._socket.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, struct.pack("HP", len(lines), ctypes.addressof(code)))
