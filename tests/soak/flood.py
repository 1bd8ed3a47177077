"""What a stranger can send to a swarm: noise, forgeries of announcements that were heard, and these once more, 5,000
datagrams a second.

Called by tests/soak/run as: flood.py ADDRESS PORT ROBOTS SECONDS
"""

import contextlib
import random
import socket
import sys
import time

RATE_HZ = 5000


def flood(address, port, robots, seconds):
    groups = [("239.255.76.68", port)] + [("239.255.76.67", port + 33 + k) for k in range(robots)]
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listener.bind(groups[0])
    membership = socket.inet_aton(groups[0][0]) + socket.inet_aton(address)
    listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
    listener.settimeout(0.5)
    heard = []
    with contextlib.suppress(TimeoutError):
        while len(heard) < 50:
            heard.append(listener.recv(65536))
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 8)
    chance = random.Random()
    begin, sent = time.monotonic(), 0
    while (now := time.monotonic()) < begin + seconds:
        while sent < (now - begin) * RATE_HZ:
            sent += 1
            kind = sent % 3
            data = bytearray(chance.choice(heard)) if heard and kind else bytearray(chance.randbytes(chance.randint(0, 1400)))
            if kind == 1 and data:  # forged
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
            with contextlib.suppress(OSError):
                out.sendto(bytes(data), groups[0] if sent % 4 else chance.choice(groups))
        time.sleep(0.002)


if __name__ == "__main__":
    flood(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4]))
