"""Robots on computers of their own, for the soak: network namespaces on one bridge, clocks that can be set, and daemons
that are kept alive as their units would have it."""

import contextlib
import mmap
import os
import pathlib
import signal
import socket
import struct
import subprocess
import sys
import time

TOP = pathlib.Path(__file__).resolve().parent.parent.parent
ROBOTS = range(4)
DAEMONS = ("map_daemon", "planner_daemon", "broadcast_daemon")
PREFIX = f"soak{os.getpid()}-"
HUB = PREFIX + "hub"
HUB_ADDRESS = "10.78.0.254"
PORT = 17667  # of the swarm bus; robot k's onboard bus is this + 33 + k
WATCHDOG_S, RESTART_S = 0.8, 0.05  # as in tools/deploy/daemon.service.in


def sh(command):
    subprocess.run(command.split(), check=True, stdout=subprocess.DEVNULL)


class Network:
    """A namespace for each robot, all on one bridge; so is a stranger's (the hub)."""

    def __enter__(self):
        sh(f"ip netns add {HUB}")
        sh(f"ip -n {HUB} link add br0 type bridge mcast_snooping 0")
        sh(f"ip -n {HUB} addr add {HUB_ADDRESS}/24 dev br0")
        sh(f"ip -n {HUB} link set br0 up")
        sh(f"ip -n {HUB} route add 224.0.0.0/4 dev br0")
        for k in ROBOTS:
            name = PREFIX + str(k)
            sh(f"ip netns add {name}")
            sh(f"ip -n {name} link add eth0 type veth peer name p{k} netns {HUB}")
            sh(f"ip -n {HUB} link set p{k} master br0")
            sh(f"ip -n {HUB} link set p{k} up")
            sh(f"ip -n {name} link set lo up")
            sh(f"ip -n {name} addr add 10.78.0.{k + 1}/24 dev eth0")
            sh(f"ip -n {name} link set eth0 up")
            sh(f"ip -n {name} route add 224.0.0.0/4 dev eth0")
        return self

    def __exit__(self, *_):
        for name in [PREFIX + str(k) for k in ROBOTS] + [HUB]:
            subprocess.run(["ip", "netns", "delete", name], check=False, stderr=subprocess.DEVNULL)

    def plug(self, robot, up):
        sh(f"ip -n {HUB} link set p{robot} {'up' if up else 'down'}")


class Clock:
    """A robot's wall clock."""

    def __init__(self, path):
        self.path = path
        path.write_bytes(bytes(8))
        with open(path, "r+b") as file:
            self.memory = mmap.mmap(file.fileno(), 8)

    def set_ahead(self, seconds):
        self.memory[:] = struct.pack("=q", round(seconds * 1e9))


class Standstills:
    """Whether the machine itself stands still, as virtual ones do: then nobody on it can give a sign. A process with a
    higher real-time priority than all others tells how long it had to wait."""

    PERIOD_S, WORTH_S = 0.005, 0.05

    def __init__(self):
        self.memory = mmap.mmap(-1, 16)  # shared with the child: in all, the longest [s]
        self.process = os.fork()
        if self.process == 0:
            self.watch()

    def watch(self):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(60))
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        before, all_s, longest_s = time.monotonic(), 0.0, 0.0
        while os.getppid() != 1:
            time.sleep(self.PERIOD_S)
            now = time.monotonic()
            if now - before > self.WORTH_S:
                all_s += now - before
                longest_s = max(longest_s, now - before)
                self.memory[:] = struct.pack("=dd", all_s, longest_s)
            before = now
        os._exit(0)

    def all_s(self):
        return struct.unpack("=dd", self.memory[:])[0]

    def longest_s(self):
        return struct.unpack("=dd", self.memory[:])[1]

    def end(self):
        os.kill(self.process, signal.SIGKILL)
        os.waitpid(self.process, 0)


class Daemon:
    """One daemon, kept alive as systemd would."""

    def __init__(self, robot, name, arguments, out, clock, shim, standstills):
        self.robot, self.name, self.clock, self.shim, self.standstills = robot, name, clock, shim, standstills
        self.command = ["ip", "netns", "exec", PREFIX + str(robot), str(TOP / "build/bin" / name), *arguments]
        self.log = open(out / f"robot{robot}-{name}.log", "wb")
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket_path = out / f"{robot}-{name}.notify"
        self.socket_path.unlink(missing_ok=True)
        self.socket.bind(str(self.socket_path))
        self.socket.setblocking(False)
        now = time.monotonic()
        self.process, self.start_at = None, 0.0
        self.down_since = self.last_sign = self.mark(now)
        self.ready, self.started = False, now
        self.restarts, self.longest_s, self.unexpected = 0, 0.0, 0
        self.expected = True

    def __str__(self):
        return f"robot {self.robot}'s {self.name}"

    def mark(self, now):
        """(now, how long the machine stood still until now [s])."""
        return now, self.standstills.all_s()

    def since(self, mark, now):
        """Seconds in which the machine ran."""
        return now - mark[0] - (self.standstills.all_s() - mark[1])

    def start(self):
        environment = dict(
            os.environ,
            NOTIFY_SOCKET=str(self.socket_path),
            WATCHDOG_USEC=str(round(WATCHDOG_S * 1e6)),
            LD_PRELOAD=str(self.shim),
            SHIFTED_CLOCK=str(self.clock.path),
        )
        self.process = subprocess.Popen(self.command, env=environment, stdout=self.log, stderr=self.log)
        if self.name == "broadcast_daemon":
            os.sched_setscheduler(self.process.pid, os.SCHED_FIFO, os.sched_param(20))
        else:
            os.setpriority(os.PRIO_PROCESS, self.process.pid, -5)
        self.started = time.monotonic()
        self.last_sign = self.mark(self.started)
        self.ready = False

    def read(self, now):
        with contextlib.suppress(BlockingIOError):
            while True:
                text = self.socket.recv(4096).decode()
                self.last_sign = self.mark(now)
                if "READY=1" in text and not self.ready:
                    self.ready = True
                    took = self.since(self.down_since, now)
                    if self.restarts:
                        self.longest_s = max(self.longest_s, took)
                    self.restarts += 1

    def strike(self, number):
        """What goes wrong now is meant: the daemon is down from here on. False: it is down already."""
        if self.process is None or not self.ready:
            return False
        self.expected, self.down_since = True, self.mark(time.monotonic())
        self.process.send_signal(number)
        return True

    def follow(self, now):
        if self.process is None:
            if now >= self.start_at:
                self.start()
        elif self.process.poll() is not None:
            if not self.expected:
                self.unexpected += 1
                self.down_since = self.mark(now)
                print(f"soak: {self} ended by itself: {self.process.returncode}", file=sys.stderr)
            self.expected = False
            self.process, self.start_at = None, now + RESTART_S
        elif self.since(self.last_sign, now) > WATCHDOG_S:
            if not self.expected:
                self.unexpected += 1
                self.down_since = self.last_sign
                print(f"soak: {self} gave no sign for {self.since(self.last_sign, now):.2f} s", file=sys.stderr)
            self.expected = True
            self.process.kill()

    def resident_kb(self):
        try:
            text = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
            return next(int(line.split()[1]) for line in text.splitlines() if line.startswith("VmRSS"))
        except (OSError, AttributeError, StopIteration):
            return 0

    def end(self):
        if self.process is not None:
            self.process.send_signal(signal.SIGCONT)
            self.process.terminate()
            try:
                self.process.wait(2)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
