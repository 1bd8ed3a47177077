#!/usr/bin/env python3
"""One file for the swarm: makes every robot's configuration from it, starts and ends all of them, and tells them what to do.

Called by tools/swarm; installed as swarm_control. Long because what is done here and what on hosts is to be compared.
"""

import json
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time

USAGE = """\
Usage: tools/swarm check  [FILE]           is the file good, and can its robots fly with it
       tools/swarm env    [FILE]           writes each robot's robot-ID.env into the output directory
       tools/swarm up     [FILE]           starts all robots
       tools/swarm status [FILE]           a line for each robot
       tools/swarm tell   [FILE] ROBOT[,ROBOT...]|all ORDER|X,Y,Z...     as tools/goal: take-off, land, or places
       tools/swarm down   [FILE]           lands all robots, and ends their daemons

FILE (default: swarm.json) is a world file (swarm_sim/README.md) whose robots have no goals, with more keys that may be there:
  robots[].host   where the robot's daemons are, as ssh knows it: NAME or USER@NAME
  key             file of the swarm's key, relative to FILE; or insecure: true
  clock_error, explores (true or false), onboard_url, swarm_url   as in robot.env
Robots without hosts fly on this computer: real daemons, mavlink_bridge and a simulated flight controller each, on the ground at first.
Robots with hosts have the package installed there; up copies robot.env, key and static map to /etc/sogm_swarm, as root by sudo.

Options, after the command:
  --out DIR        logs, results and what is made; default build/swarm
  --programs DIR   where the programs are; default: those of this tree, or the installed ones
  --base-port N    of robots on this computer; default 7667
  --arrive         tell: waits until it is done
  --simulate       up: all robots on this computer, whatever their hosts
  --record         up: also LCM logs of all buses, on this computer; some 0.7 MB a second for each robot
  --now            down: without landing
  --sim "OPTIONS"  up: more options of swarm_sim run, --vehicle quadrotor --wind-mps 3, say
Exit codes: 0 done, 1 not, 2 bad input.
"""

TOP = pathlib.Path(__file__).resolve().parent.parent
OWN_KEYS = {"key", "insecure", "clock_error", "explores", "onboard_url", "swarm_url"}
SSH = shlex.split(os.environ.get("SWARM_SSH", "ssh -o BatchMode=yes -o ConnectTimeout=5"))
ETC = "/etc/sogm_swarm"
READY_S, END_S, PATIENCE_S = 60.0, 20.0, 20


class BadInput(Exception):
    """What is wrong with the file or the command line: what it is, its value, the rule."""


class Failed(Exception):
    """What could not be done, and why."""


programs = TOP / "build" / "bin"


def program(name):
    return str(programs / name) if (programs / name).exists() else name


def say(text):
    print("swarm: " + text, flush=True)


class SwarmFile:
    def __init__(self, path):
        self.path = pathlib.Path(path)
        try:
            self.world = json.loads(self.path.read_text())
        except OSError as error:
            raise BadInput(f"{path}: {error.strerror.lower()}") from None
        except ValueError as error:
            raise BadInput(f"{path}: must be JSON: {error}") from None
        if not isinstance(self.world, dict) or not isinstance(self.world.get("robots"), list) or not self.world["robots"]:
            raise BadInput(f"{path}: robots: must be a list of at least one robot")
        self.own = {key: self.world.pop(key) for key in OWN_KEYS & self.world.keys()}
        for key in ("insecure", "explores"):
            if type(self.own.get(key, False)) is not bool:
                raise BadInput(f"{path}: {key}: {self.own[key]!r} must be true or false")
        self.hosts = {}
        for place, robot in enumerate(self.world["robots"]):
            if not isinstance(robot, dict) or type(robot.get("id")) is not int:
                raise BadInput(f"{path}: robots[{place}].id: must be a whole number")
            for key in ("goal", "goals"):
                if key in robot:
                    raise BadInput(f"{path}: robots[{place}].{key}: robots of a swarm file have none; tools/swarm tell sends them somewhere")
            host = robot.pop("host", None)
            if host is not None:
                if not isinstance(host, str) or not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.@:-]*", host):
                    raise BadInput(f"{path}: robots[{place}].host: {host!r} must be NAME or USER@NAME")
                self.hosts[robot["id"]] = host
        if self.hosts and len(self.hosts) != len(self.world["robots"]):
            raise BadInput(f"{path}: robots: all have a host, or none has")
        self.ids = [robot["id"] for robot in self.world["robots"]]
        if "static_map" in self.world:
            self.world["static_map"] = str((self.path.parent / self.world["static_map"]).resolve())

    def write_world(self, directory):
        made = directory / "swarm_world.json"
        made.write_text(json.dumps(self.world, indent=1))
        return made

    def check_world(self, directory):
        made = self.write_world(directory)
        told = subprocess.run([program("swarm_sim"), "world", "--world", str(made), "--describe"], capture_output=True, text=True)
        if told.returncode != 0:
            raise BadInput(told.stderr.strip().splitlines()[-1].replace("swarm_sim world: ", "").replace(str(made), str(self.path)))
        return made

    def value(self, key, default):
        return self.own.get(key, default)

    def key_file(self):
        return (self.path.parent / self.own["key"]).resolve() if "key" in self.own else None

    def env_of(self, robot):
        """robot.env's text, with this robot's values."""
        limits = {**self.world.get("limits", {}), **robot.get("limits", {})}
        vector = lambda values: ",".join(f"{value:g}" for value in values)
        values = {
            "ROBOT_ID": robot["id"],
            "ROSTER": ",".join(map(str, self.ids)),
            "RADIUS": f"{robot.get('radius', 0.2):g}",
            "V_MAX": f"{limits['speed']:g}",
            "A_MAX": f"{limits['acceleration']:g}",
            "J_MAX": f"{limits.get('jerk', 0):g}",
            "SPACE_MIN": vector(self.world["space"]["min"]),
            "SPACE_MAX": vector(self.world["space"]["max"]),
            "STATIC_MAP": f"{ETC}/{pathlib.Path(self.world['static_map']).name}" if "static_map" in self.world else "",
            "EXPLORES": str(self.value("explores", True)).lower(),
            "CLOCK_ERROR": f"{self.value('clock_error', 0.01):g}",
            "INSECURE": str(self.value("insecure", False)).lower(),
            "ONBOARD_URL": self.value("onboard_url", "udpm://239.255.76.67:7700?ttl=0"),
            "SWARM_URL": self.value("swarm_url", "udpm://239.255.76.68:7667?ttl=1"),
        }
        template = next((path for path in (TOP / "tools/deploy/robot.env", pathlib.Path(ETC) / "robot.env") if path.exists()), None)
        if template is None:
            raise Failed(f"no template of robot.env, neither in this tree nor in {ETC}")
        lines = template.read_text().splitlines()
        for name, value in values.items():
            lines = [f"{name}={value}" if line.startswith(name + "=") else line for line in lines]
        return "\n".join(lines) + "\n"

    def write_envs(self, directory):
        for robot in self.world["robots"]:
            (directory / f"robot-{robot['id']}.env").write_text(self.env_of(robot))


def on_host(host, command, text=None, quiet=False):
    """Runs a command there; its standard input is `text`. Returns what it printed, and its exit code."""
    done = subprocess.run([*SSH, host, command], input=text, capture_output=True)
    if done.returncode == 255:
        raise Failed(f"{host}: {done.stderr.decode(errors='replace').strip() or 'ssh failed'}")
    if not quiet and done.returncode != 0:
        raise Failed(f"{host}: '{command}' failed: {(done.stderr or done.stdout).decode(errors='replace').strip()}")
    return done.stdout.decode(errors="replace"), done.returncode


class Local:
    """All robots in one simulator on this computer."""

    def __init__(self, swarm, options):
        self.swarm, self.out, self.port = swarm, options.out, options.base_port
        self.note = self.out / "swarm.up"

    def running(self):
        try:
            note = json.loads(self.note.read_text())
            command = pathlib.Path(f"/proc/{note['pid']}/cmdline").read_bytes()
        except (OSError, ValueError, KeyError):
            return None
        if str(self.out).encode() not in command:
            return None  # another process has its number
        self.port = note["base_port"]
        return note["pid"]

    def up(self, options):
        if self.running():
            raise Failed(f"is up already (process {self.running()}); tools/swarm down ends it")
        world = self.swarm.check_world(self.out)
        log = self.out / "swarm_sim.txt"
        command = [program("swarm_sim"), "run", str(world), "--mode", "processes", "--mavlink", "position", "--on-ground", "true",
                   "--time-limit", "86400", "--log-buses", "true" if options.record else "false", "--base-port", str(self.port), "--out", str(self.out), *shlex.split(options.sim)]
        with open(log, "wb") as file:
            process = subprocess.Popen(command, stdout=file, stderr=file, stdin=subprocess.DEVNULL, start_new_session=True)
        self.note.write_text(json.dumps({"pid": process.pid, "base_port": self.port}))
        deadline = time.monotonic() + READY_S
        while "t =" not in log.read_text(errors="replace"):
            if process.poll() is not None or time.monotonic() > deadline:
                process.terminate()
                process.wait()
                self.note.unlink()
                raise Failed("did not start: " + (log.read_text(errors="replace").strip().splitlines() or ["it said nothing"])[-1])
            time.sleep(0.1)
        say(f"up: {len(self.swarm.ids)} robots on the ground; logs in {self.out}")

    def need_running(self):
        pid = self.running()
        if pid is None:
            raise Failed("is not up; tools/swarm up starts it")
        return pid

    def status(self):
        self.need_running()
        ids = ",".join(map(str, self.swarm.ids))
        return subprocess.run([program("swarm_status"), "--base-port", str(self.port), ids]).returncode

    def tell(self, ids, words, arrive):
        self.need_running()
        orders = []
        for chosen in ([",".join(map(str, ids))] if not any("," in word for word in words) else map(str, ids)):
            orders += [chosen, *words]
        return subprocess.run([program("swarm_goal"), "--base-port", str(self.port), "--arrive", "true" if arrive else "false",
                               "--patience", str(PATIENCE_S), *orders]).returncode

    def down(self, now):
        pid = self.need_running()
        if not now and self.tell(self.swarm.ids, ["land"], True) != 0:
            raise Failed("not all robots have landed; down --now ends all the same")
        os.kill(pid, signal.SIGTERM)
        deadline = time.monotonic() + END_S
        while self.running():
            if time.monotonic() > deadline:
                raise Failed(f"process {pid} does not end")
            time.sleep(0.1)
        self.note.unlink(missing_ok=True)
        say(f"down; results in {self.out}")


class Hosts:
    """Each robot's daemons as services on its own computer."""

    def __init__(self, swarm, options):
        self.swarm, self.out = swarm, options.out
        self.url = shlex.quote(swarm.value("onboard_url", "udpm://239.255.76.67:7700?ttl=0"))

    def up(self, options):
        key = self.swarm.key_file()
        if key is None and not self.swarm.value("insecure", False):
            raise BadInput(f"{self.swarm.path}: key: must name the file of the swarm's key (tools/new_key makes one), or insecure must be true")
        key_text = None
        if key is not None:
            try:
                key_text = key.read_bytes()
            except OSError as error:
                raise BadInput(f"{self.swarm.path}: key: {key}: {error.strerror.lower()}") from None
        for robot in self.swarm.world["robots"]:
            host = self.swarm.hosts[robot["id"]]
            on_host(host, f"sudo tee {ETC}/robot.env > /dev/null", self.swarm.env_of(robot).encode())
            if key_text is not None:
                on_host(host, f"sudo install -m 600 /dev/stdin {ETC}/swarm.key", key_text)
            if "static_map" in self.swarm.world:
                path = pathlib.Path(self.swarm.world["static_map"])
                on_host(host, f"sudo tee {shlex.quote(f'{ETC}/{path.name}')} > /dev/null", path.read_bytes())
            on_host(host, "sudo systemctl restart swarm.target")
            say(f"robot {robot['id']} on {host}: started")

    def check(self):
        fails = 0
        for robot, host in self.swarm.hosts.items():
            lines, code = on_host(host, "sudo swarm_check_machine", quiet=True)
            fails += code != 0
            for line in lines.splitlines():
                if code == 0 or line.startswith("FAIL"):
                    print(f"robot {robot} on {host}: {line}")
        return 1 if fails else 0

    def status(self):
        worst = 0
        for robot, host in self.swarm.hosts.items():
            try:
                lines, code = on_host(host, f"swarm_status --onboard-url {self.url} {robot}", quiet=True)
            except Failed as error:
                lines, code = f"robot {robot}  ! {error}\n", 1
            print(lines, end="", flush=True)
            worst = max(worst, code)
        return worst

    def tell(self, ids, words, arrive):
        told = [(robot, self.swarm.hosts[robot]) for robot in ids]
        command = "swarm_goal --onboard-url {} --arrive {} --patience {} {} {}"
        running = [(robot, host, subprocess.Popen([*SSH, host, command.format(self.url, "true" if arrive else "false", PATIENCE_S, robot,
                                                                               " ".join(map(shlex.quote, words)))])) for robot, host in told]
        return max(process.wait() for _, _, process in running)

    def down(self, now):
        if not now and self.tell(self.swarm.ids, ["land"], True) != 0:
            raise Failed("not all robots have landed; down --now ends all the same")
        for robot, host in self.swarm.hosts.items():
            on_host(host, "sudo systemctl stop swarm.target")
            say(f"robot {robot} on {host}: stopped")


def check(swarm, where, out):
    swarm.check_world(out)
    for robot in swarm.world["robots"]:
        with tempfile.TemporaryDirectory() as directory:
            (pathlib.Path(directory) / "robot.env").write_text(swarm.env_of(robot))
            checker = TOP / "tools/check_machine"
            where_programs = ["--programs", str(programs)] if programs.exists() else []
            told = subprocess.run([str(checker if checker.exists() else "swarm_check_machine"), "--config", directory, "--only", "configuration", *where_programs],
                                  capture_output=True, text=True)
            for line in told.stdout.splitlines():
                if line.startswith("FAIL"):
                    raise BadInput(f"{swarm.path}: robot {robot['id']}: " + line.removeprefix("FAIL").strip().replace(f" ({directory})", ""))
    code = where.check() if isinstance(where, Hosts) else 0
    if code == 0:
        say(f"{swarm.path} is good: {len(swarm.ids)} robots")
    return code


def ids_of(swarm, word):
    if word == "all":
        return swarm.ids
    ids = []
    for one in word.split(","):
        if not one.isdigit() or int(one) not in swarm.ids:
            raise BadInput(f"robot '{one}': must be one of {','.join(map(str, swarm.ids))}, or all")
        ids.append(int(one))
    return ids


class Options:
    """The command, its words, and what was said after --."""

    def __init__(self):
        self.command, self.words, self.programs, self.sim = "", [], None, ""
        self.out = TOP / "build" / "swarm" if (TOP / "CMakeLists.txt").exists() else pathlib.Path("swarm_flight")
        self.base_port, self.arrive, self.simulate, self.record, self.now = 7667, False, False, False, False


def read_options(arguments):
    """Places may begin with a minus sign, so that argparse takes them for options."""
    options = Options()
    kinds = {"--out": pathlib.Path, "--programs": pathlib.Path, "--base-port": int, "--sim": str, "--arrive": bool, "--simulate": bool, "--record": bool, "--now": bool}
    rest = list(arguments)
    while rest:
        word = rest.pop(0)
        if not word.startswith("--"):
            options.words.append(word)
            continue
        if word not in kinds:
            raise BadInput(f"unknown option '{word}' (see --help)")
        value = True
        if kinds[word] is not bool:
            if not rest:
                raise BadInput(f"{word}: needs a value (see --help)")
            try:
                value = kinds[word](rest.pop(0))
            except ValueError:
                raise BadInput(f"{word}: must be a whole number") from None
        setattr(options, word[2:].replace("-", "_"), value)
    commands = ("check", "env", "up", "status", "tell", "down")
    if not options.words or options.words[0] not in commands:
        raise BadInput(f"{repr(options.words[0]) if options.words else 'nothing'}: must be one of {', '.join(commands)} (see --help)")
    options.command = options.words.pop(0)
    return options


def main(arguments):
    if arguments and arguments[0] in ("-h", "--help"):
        print(USAGE, end="")
        return 0
    options = read_options(arguments)
    if not 1024 <= options.base_port <= 60000:
        raise BadInput(f"--base-port {options.base_port}: must be within [1024, 60000]")
    words = options.words
    path = words.pop(0) if words and words[0].endswith(".json") else "swarm.json"
    if words and options.command != "tell":
        raise BadInput(f"'{words[0]}': {options.command} takes the swarm's file (.json) alone")
    if options.command == "tell" and len(words) < 2:
        raise BadInput("tell: must be followed by ROBOT[,ROBOT...] or all, and an order or places")
    swarm = SwarmFile(path)
    options.out = options.out.resolve()
    options.out.mkdir(parents=True, exist_ok=True)
    global programs
    if options.programs:
        programs = options.programs.resolve()
    local = Local(swarm, options)
    where = Hosts(swarm, options) if swarm.hosts and not options.simulate and not local.running() else local
    if options.command == "check":
        return check(swarm, where, options.out)
    if options.command == "env":
        swarm.check_world(options.out)
        swarm.write_envs(options.out)
        say(f"{', '.join(f'robot-{robot}.env' for robot in swarm.ids)} in {options.out}")
        return 0
    if options.command == "up":
        check(swarm, local, options.out)
        where.up(options)
        return 0
    if options.command == "status":
        return where.status()
    if options.command == "tell":
        return where.tell(ids_of(swarm, words[0]), words[1:], options.arrive)
    where.down(options.now)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except BadInput as error:
        print(f"swarm: {error}", file=sys.stderr)
        sys.exit(2)
    except (Failed, subprocess.CalledProcessError) as error:
        print(f"swarm: {error}", file=sys.stderr)
        sys.exit(1)
