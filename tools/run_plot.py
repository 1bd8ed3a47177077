"""Draws a run of `swarm_sim run --out DIR`: seen from above, speed and clearance over time; or a movie.

Called by tools/plot_run as: run_plot.py DIR OUT [TIME_S], and by tools/movie as: run_plot.py DIR OUT.mp4|.gif|.svg --movie SPEED
Reads world.json, trace.csv, report.json and, where there is one, commanded.csv. Knows the obstacles' motion and distance from world.json by itself, so that
what it draws also checks what swarm_sim reports. A static map is not drawn.
"""

import csv
import json
import pathlib
import subprocess
import sys

import matplotlib

matplotlib.use("Agg")
matplotlib.rcParams.update({"font.size": 9, "svg.hashsalt": "sogm_swarm", "axes.spines.top": False, "axes.spines.right": False})
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from run_animation import animation  # noqa: E402

COLORS = plt.get_cmap("tab10").colors
SOLID = {"facecolor": "#c8c8c8", "edgecolor": "#707070", "linewidth": 0.7}
FRAMES_PER_S = 25
SWAY_PERIOD = 4.0  # of obstacles that accelerate [s]
TAIL = 200  # of the trace's steps of 10 ms


class BadInput(Exception):
    """What is wrong with a run: one line with file and rule."""


def rows_of(text):
    return np.array([[float(value) for value in row] for row in list(csv.reader(text.splitlines()))[1:]])


class Run:
    def __init__(self, directory):
        directory = pathlib.Path(directory)
        texts, commanded = {}, directory / "commanded.csv"
        for name in ("world.json", "report.json", "trace.csv"):
            try:
                texts[name] = (directory / name).read_text(encoding="utf-8")
            except OSError as error:
                raise BadInput(f"{directory / name}: {error.strerror}; must be of a run with --out") from None
        try:
            self.world, self.report = json.loads(texts["world.json"]), json.loads(texts["report.json"])
            rows = rows_of(texts["trace.csv"])
            self.robots = {robot["id"]: robot for robot in self.world["robots"]}
            self.goals = {i: [goal["position"] for goal in robot.get("goals", [])] or [robot[key] for key in ["goal"] if key in robot] for i, robot in self.robots.items()}
            self.traces = {i: rows[rows[:, 1] == i] for i in self.robots}
            told = rows_of(commanded.read_text(encoding="utf-8")) if commanded.exists() else None
            self.commanded = {} if told is None else {i: told[told[:, 1] == i] for i in self.robots}
            self.t = self.traces[next(iter(self.robots))][:, 0]
            complete = len(self.t) > 0 and all(trace.shape == (len(self.t), 11) for traces in (self.traces, self.commanded) for trace in traces.values())
        except (ValueError, KeyError, IndexError, TypeError, StopIteration) as error:
            raise BadInput(f"{directory}: cannot be understood: {error!r}") from None
        if not complete:
            raise BadInput(f"{directory / 'trace.csv'}: must hold every robot of world.json at every time")
        space = self.world["space"]
        self.bounds = self.world.get("obstacle_bounds", {"min": space["min"][:2], "max": space["max"][:2]})
        self.obstacles, self.walls = self.world.get("obstacles", []), self.world.get("walls", [])

    def color(self, robot):
        return COLORS[list(self.robots).index(robot) % len(COLORS)]

    def obstacle_at(self, obstacle, t):
        """Centres (n, 3) at times t (n,), NaN while it does not exist, and its speed (n, 2) [m, m/s, W]."""
        height = obstacle.get("center", [0, 0, 0])[2:] or [obstacle.get("height", 0.0) / 2]
        if "track" in obstacle:
            track = np.array(obstacle["track"])
            inside = (t >= track[0, 0]) & (t <= track[-1, 0])
            xy = np.stack([np.where(inside, np.interp(t, track[:, 0], track[:, k]), np.nan) for k in (1, 2)], axis=1)
            i = np.clip(np.searchsorted(track[:, 0], t, side="right") - 1, 0, len(track) - 2)
            speed = ((track[i + 1] - track[i]) / (track[i + 1, :1] - track[i, :1]))[:, 1:]
        else:
            # A path that reflects at both walls is a straight one, folded.
            start, velocity = np.array(obstacle["center"][:2], dtype=float), np.array(obstacle.get("velocity", [0, 0]), dtype=float)
            bounds = obstacle.get("bounds", self.bounds)
            low, width = np.array(bounds["min"]), np.subtract(bounds["max"], bounds["min"])
            phase = np.mod(start - low + np.outer(t, velocity), 2 * width)
            xy = np.where(velocity != 0, low + np.where(phase < width, phase, 2 * width - phase), start)
            # One that accelerates goes round a circle on top of that.
            ahead, rate = velocity / (np.hypot(*velocity) or 1.0), (-1 if np.prod(velocity) < 0 else 1) * 2 * np.pi / SWAY_PERIOD
            radius = obstacle.get("acceleration", 0.0) / rate**2
            turned = np.outer(np.cos(rate * t), ahead) + np.outer(np.sin(rate * t), [-ahead[1], ahead[0]])
            xy = xy + radius * (ahead - turned)
            speed = np.where(phase < width, 1, -1) * velocity + radius * rate * np.column_stack([turned[:, 1], -turned[:, 0]])
        return np.column_stack([xy, np.full(len(t), height[0])]), speed

    def distance(self, obstacle, points):
        """From points (n, 3), relative to its centre, to the solid [m]."""
        shape, yaw = obstacle["shape"], obstacle.get("yaw", 0.0)
        along = points[:, 0] * np.cos(yaw) + points[:, 1] * np.sin(yaw)
        across = points[:, 1] * np.cos(yaw) - points[:, 0] * np.sin(yaw)
        if shape == "column":
            beside = np.maximum(np.hypot(points[:, 0], points[:, 1]) - obstacle["diameter"] / 2, 0)
            return np.hypot(beside, np.maximum(np.abs(points[:, 2]) - obstacle["height"] / 2, 0))
        if shape == "ring":  # its axis is horizontal, along yaw
            tube = np.hypot(np.hypot(across, points[:, 2]) - obstacle["radius"], along)
            return np.maximum(tube - obstacle["width"] / 2, 0)
        if shape == "box":
            outside = np.abs(np.column_stack([along, across, points[:, 2]])) - np.array(obstacle["size"]) / 2
            return np.linalg.norm(np.maximum(outside, 0), axis=1)
        return np.maximum(np.linalg.norm(points, axis=1) - obstacle["diameter"] / 2, 0)

    def clearances(self):
        """By robot: (to the nearest obstacle, to the nearest robot) at every time, between surfaces [m]."""
        centers = [self.obstacle_at(obstacle, self.t)[0] for obstacle in self.obstacles]
        result = {}
        for i, trace in self.traces.items():
            position, radius = trace[:, 2:5], self.robots[i]["radius"]
            obstacles, robots = np.full(len(self.t), np.inf), np.full(len(self.t), np.inf)
            for obstacle, center in zip(self.obstacles, centers):
                obstacles = np.fmin(obstacles, self.distance(obstacle, position - center) - radius)
            for j, other in self.traces.items():
                if j != i:
                    gap = np.linalg.norm(position - other[:, 2:5], axis=1) - radius - self.robots[j]["radius"]
                    robots = np.minimum(robots, gap)
            result[i] = (obstacles, robots)
        return result


def outline(obstacle, center):
    """Seen from above."""
    shape, yaw = obstacle["shape"], obstacle.get("yaw", 0.0)
    if shape in ("column", "sphere"):
        return plt.Circle(center[:2], obstacle["diameter"] / 2, **SOLID)
    size = obstacle["size"][:2] if shape == "box" else (obstacle["width"], 2 * obstacle["radius"] + obstacle["width"])
    to_corner = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]) @ size / 2
    return plt.Rectangle(np.array(center[:2]) - to_corner, *size, angle=np.degrees(yaw), **SOLID)  # turns about this corner


def draw_scene(axis, run, k, since=0):
    """Obstacles with arrows of a second's way, robots where they are at run.t[k], and their ways from run.t[since] on."""
    t = run.t[k : k + 1]
    for obstacle in run.obstacles:
        center, speed = (values[0] for values in run.obstacle_at(obstacle, t))
        if np.isnan(center[0]):
            continue
        axis.add_patch(outline(obstacle, center))
        if np.any(speed != 0):
            axis.annotate("", center[:2] + speed, center[:2], arrowprops={"arrowstyle": "->", "color": "#404040", "linewidth": 0.7})
    for wall in run.walls:
        axis.add_patch(plt.Rectangle(wall["min"][:2], *np.subtract(wall["max"], wall["min"])[:2], **SOLID))
    for i, trace in run.traces.items():
        color, goals = run.color(i), np.array(run.goals[i]).reshape(-1, 3)
        axis.plot(trace[since:, 2], trace[since:, 3], color=color, linewidth=1.2, label=f"robot {i}")
        axis.plot(goals[:, 0], goals[:, 1], marker="x", linestyle="none", color=color, markersize=6)
        axis.add_patch(plt.Circle(trace[k, 2:4], run.robots[i]["radius"], color=color, zorder=3))
    space = run.world["space"]
    axis.set(xlim=(space["min"][0] - 1, space["max"][0] + 1), ylim=(space["min"][1] - 1, space["max"][1] + 1), aspect="equal", xlabel="x [m]", ylabel="y [m]")


def nearest(run, clearances):
    """(gap, index of the time, robot, 0: to an obstacle or 1: to a robot), the smallest first; each kind of each robot once."""
    found = []
    for i, kinds in clearances.items():
        for kind, gaps in enumerate(kinds):
            k = int(np.argmin(gaps))
            if np.isfinite(gaps[k]):
                found.append((float(gaps[k]), k, i, kind))
    return sorted(found)


def from_above(run, clearances, time_s):
    found = nearest(run, clearances)
    k = int(np.argmin(np.abs(run.t - time_s))) if time_s is not None else found[0][1] if found else len(run.t) // 2
    figure, axis = plt.subplots(figsize=(7, 6.4), layout="constrained")
    draw_scene(axis, run, k)
    for i, trace in run.traces.items():
        seconds = trace[np.isclose(np.mod(trace[:, 0] + 1e-6, 1.0), 0.0, atol=5e-3)]
        axis.plot(seconds[:, 2], seconds[:, 3], ".", color=run.color(i), markersize=3)
    told = {(at, kind) if kind == 1 else (at, i): (gap, at, i, kind) for gap, at, i, kind in reversed(found)}  # two robots once
    for n, (gap, at, i, kind) in enumerate(sorted(told.values())[:4]):
        place = run.traces[i][at, 2:4]
        what = "obstacle" if kind == 0 else "robot"
        axis.annotate(f"{gap:.2f} m to {what}, {run.t[at]:.1f} s", place, textcoords="offset points", xytext=((14, 40), (14, -46), (-120, 40), (-120, -46))[n], fontsize=7.5, arrowprops={"arrowstyle": "-", "color": "black", "linewidth": 0.6}, bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.8, "linewidth": 0})
    axis.set_title(f"{run.report['world']}: {run.report['outcome']}; obstacles and robots at {run.t[k]:.1f} s, dots every second", fontsize=9)
    axis.legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    return figure


def over_time(run, clearances):
    rows = 4 if run.commanded else 3
    figure, axes = plt.subplots(rows, 1, figsize=(7, 2.1 * rows + 0.1), sharex=True, layout="constrained")
    for i, trace in run.traces.items():
        color = run.color(i)
        axes[0].plot(run.t, np.linalg.norm(trace[:, 5:8], axis=1), color=color, linewidth=1, label=f"robot {i}")
        for axis, gaps in zip(axes[1:], clearances[i]):
            if np.any(np.isfinite(gaps)):
                axis.plot(run.t, gaps, color=color, linewidth=1)
        if run.commanded:
            axes[3].plot(run.t, np.linalg.norm(trace[:, 2:5] - run.commanded[i][:, 2:5], axis=1), color=color, linewidth=1)
    axes[0].set_ylabel("speed [m/s]")
    if run.commanded:
        axes[3].set_ylabel("from where it was told to be [m]")
    for axis, what in zip(axes[1:], ("obstacle", "robot")):
        axis.axhline(0.0, color="black", linewidth=0.8)
        axis.set(ylabel=f"to the nearest {what} [m]", ylim=(-0.1, 2.0))
    axes[-1].set_xlabel("t [s]")
    axes[0].legend(loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    return figure


def plot(run, out, time_s):
    out.mkdir(parents=True, exist_ok=True)
    clearances = run.clearances()
    for name, figure in (("from_above", from_above(run, clearances, time_s)), ("over_time", over_time(run, clearances))):
        for ending in ("svg", "png"):
            figure.savefig(out / f"{name}.{ending}", dpi=150, metadata={"Date": None} if ending == "svg" else None)
        print(f"plot_run: {out / name}.svg and .png")
    for gap, k, i, kind in nearest(run, clearances):
        print(f"  robot {i}: {gap:.4f} m to the nearest {'obstacle' if kind == 0 else 'robot'} at {run.t[k]:.2f} s")


def movie(run, out, speed):
    step = speed / FRAMES_PER_S
    times = np.arange(0.0, run.t[-1], step)
    figure, axis = plt.subplots(figsize=(6.4, 6.4), dpi=100, layout="constrained")
    filters = ["-vf", "fps=12,split[a][b];[a]palettegen[p];[b][p]paletteuse"] if out.suffix == ".gif" else ["-pix_fmt", "yuv420p"]
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgba", "-s", "640x640", "-r", str(FRAMES_PER_S), "-i", "-"]
    with subprocess.Popen([*command, *filters, str(out)], stdin=subprocess.PIPE) as ffmpeg:
        for n, t in enumerate(times):
            axis.clear()
            k = int(np.searchsorted(run.t, t))
            draw_scene(axis, UpTo(run, k), k, max(0, k - TAIL))
            axis.set_title(f"{run.report['world']}   {t:4.1f} s")
            figure.canvas.draw()
            ffmpeg.stdin.write(figure.canvas.buffer_rgba())
            if n % 50 == 0:
                print(f"movie: {n} of {len(times)} frames", flush=True)
        ffmpeg.stdin.close()
    if ffmpeg.returncode != 0:
        raise BadInput(f"{out}: ffmpeg could not write it")


class UpTo(Run):
    """A run as far as time k."""

    def __init__(self, run, k):
        self.__dict__.update(run.__dict__)
        self.traces = {i: trace[: k + 1] for i, trace in run.traces.items()}


def main(directory, out, *rest):
    run = Run(directory)
    if rest[:1] == ("--movie",):
        out = pathlib.Path(out)
        draw = animation if out.suffix == ".svg" else movie
        draw(run, out, float(rest[1]))
        print(f"movie: {out}")
    else:
        plot(run, pathlib.Path(out), float(rest[0]) if rest else None)


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except (BadInput, OSError) as error:
        print(f"{pathlib.Path(sys.argv[0]).stem}: {error}", file=sys.stderr)
        sys.exit(2)
