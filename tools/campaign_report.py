"""Draws the results of `swarm_sim campaign`: figures as SVG and PNG, and one HTML page that holds them all.

Called by tools/report as: campaign_report.py RESULTS.csv DIRECTORY
"""

import collections
import csv
import html
import io
import pathlib
import statistics
import sys

import matplotlib

matplotlib.use("Agg")
matplotlib.rcParams.update({"font.size": 9, "svg.hashsalt": "sogm_swarm", "axes.spines.top": False, "axes.spines.right": False})
import matplotlib.pyplot as plt  # noqa: E402

STEPS = ["compose", "search", "corridor", "optimize", "check", "total", "prepare"]
COLORS = {"success": "#3a923a", "collision": "#c03d3e", "stuck": "#e1a02f"}
# Success [%] by number of obstacles: the paper's own judge sees robots as points and ignores rings; it reports means.
# The mended reference code was judged as here, by spheres and exact geometry (tasks pooled).
PAPER = {"mixed": [((10, 20, 30), 95.3), ((40, 50), 73.0)], "pure": [((10, 20, 30), 88.5)]}
MENDED = {"mixed": {10: 92, 20: 73, 30: 47, 40: 22, 50: 17}, "pure": {10: 93, 20: 77, 30: 73, 40: 50, 50: 27}}
MENDED_FLIGHT_S, LEAST_FLIGHT_S = 11.9, 8.3


class BadInput(Exception):
    """What is wrong with the results: one line with file, line and rule."""


def read_rows(path):
    needed = ["trial", "task", "env", "obstacles", "outcome", "touches", "last_arrival_s", "command"]
    needed += [f"{step}_{statistic}_ms" for step in STEPS for statistic in ("p50", "p99")]
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        missing = [name for name in needed if name not in (reader.fieldnames or [])]
        if missing:
            raise BadInput(f"{path}: line 1: column {missing[0]} is missing")
        rows = []
        for row in reader:
            try:
                row["obstacles"] = int(row["obstacles"])
                row["result"] = row["outcome"] if row["outcome"] in ("success", "collision") else "stuck"
                row["last_arrival_s"] = float(row["last_arrival_s"]) if row["result"] == "success" else None
                for name in needed[8:]:
                    row[name] = float(row[name])
            except (TypeError, ValueError) as error:
                raise BadInput(f"{path}: line {reader.line_num}: {error}") from None
            rows.append(row)
    if not rows:
        raise BadInput(f"{path}: must hold at least one trial")
    return rows


def grouped(rows, *keys):
    groups = collections.defaultdict(list)
    for row in rows:
        groups[tuple(row[key] for key in keys)].append(row)
    return dict(sorted(groups.items()))


def share(rows, result):
    return 100.0 * sum(row["result"] == result for row in rows) / len(rows)


def panels(rows, height):
    """One panel per task and environment, numbers of obstacles along x."""
    worlds = list(grouped(rows, "env", "task"))
    envs, tasks = sorted({env for env, _ in worlds}), sorted({task for _, task in worlds})
    figure, axes = plt.subplots(len(envs), len(tasks), figsize=(3.2 * len(tasks) + 1, height * len(envs) + 0.6), squeeze=False, sharex=True, sharey=True, layout="constrained")
    for i, env in enumerate(envs):
        for j, task in enumerate(tasks):
            axis = axes[i][j]
            axis.set_title(f"{task}, {env}" if env else task)
            if i == len(envs) - 1:
                axis.set_xlabel("obstacles")
            yield figure, axis, env, task, grouped([r for r in rows if (r["env"], r["task"]) == (env, task)], "obstacles")


def draw_success(rows):
    figure, last = None, None
    for figure, axis, env, _, cells in panels(rows, 2.3):
        counts = [n for (n,) in cells]
        places = range(len(counts))
        bottom = [0.0] * len(counts)
        for result, color in COLORS.items():
            shares = [share(cell, result) for cell in cells.values()]
            axis.bar(places, shares, 0.7, bottom, color=color, label=result)
            bottom = [b + s for b, s in zip(bottom, shares)]
        for place, cell in zip(places, cells.values()):
            axis.annotate(f"{share(cell, 'success'):.0f}", (place, 3), ha="center", color="white", fontsize=8)
        known = [(p, MENDED[env][n]) for p, n in zip(places, counts) if n in MENDED.get(env, {})]
        if known:
            axis.plot(*zip(*known), "o--", color="black", ms=3, lw=0.8, label="mended reference, same judge")
        for label, (numbers, value) in zip(["the paper, its own judge", None], PAPER.get(env, [])):
            inside = [p for p, n in zip(places, counts) if n in numbers]
            if inside:
                axis.hlines(value, inside[0] - 0.45, inside[-1] + 0.45, color="navy", lw=1.6, label=label)
        axis.set_xticks(list(places), [str(n) for n in counts])
        axis.set_ylim(0, 100)
        axis.set_ylabel("trials [%]")
        axis.label_outer()
        last = axis if last is None or len(axis.get_legend_handles_labels()[1]) > len(last.get_legend_handles_labels()[1]) else last
    figure.legend(*last.get_legend_handles_labels(), loc="upper center", bbox_to_anchor=(0.5, 0), ncol=5, frameon=False)
    return figure


def draw_flight_time(rows):
    figure, axis = None, None
    for figure, axis, _, _, cells in panels(rows, 2.0):
        times = {n: sorted(row["last_arrival_s"] for row in cell if row["result"] == "success") for (n,), cell in cells.items()}
        times = {n: t for n, t in times.items() if t}
        if times:
            axis.fill_between(list(times), [t[len(t) // 10] for t in times.values()], [t[-1 - len(t) // 10] for t in times.values()], alpha=0.25, lw=0, label="10th to 90th percentile")
            axis.plot(list(times), [statistics.mean(t) for t in times.values()], "o-", ms=3, label="mean of last arrivals")
        axis.axhline(MENDED_FLIGHT_S, color="black", ls="--", lw=0.8, label="mended reference (all worlds)")
        axis.axhline(LEAST_FLIGHT_S, color="gray", ls=":", lw=0.8, label="bound at 2 m/s per axis")
        axis.set_ylabel("flight [s]")
        axis.label_outer()
    figure.legend(*axis.get_legend_handles_labels(), loc="upper center", bbox_to_anchor=(0.5, 0), ncol=4, frameon=False)
    return figure


def draw_planning_time(rows):
    cells = grouped(rows, "obstacles")
    figure, axis = plt.subplots(figsize=(8, 3.2), layout="constrained")
    width = 0.8 / len(cells)
    for k, ((n,), cell) in enumerate(cells.items()):
        places = [i + (k - (len(cells) - 1) / 2) * width for i in range(len(STEPS))]
        color = plt.get_cmap("viridis")(k / max(1, len(cells) - 1) * 0.85)
        axis.bar(places, [statistics.median(row[f"{step}_p50_ms"] for row in cell) for step in STEPS], width * 0.9, color=color, label=f"{n} obstacles")
        axis.plot(places, [statistics.median(row[f"{step}_p99_ms"] for row in cell) for step in STEPS], "_", color="black", ms=5)
    axis.set_yscale("log")
    axis.set_xticks(range(len(STEPS)), STEPS)
    axis.set_ylabel("per plan [ms]")
    axis.set_title("Planning time: median (bar) and 99th percentile (line) of a flight, median over flights")
    figure.legend(loc="upper center", bbox_to_anchor=(0.5, 0), ncol=5, frameon=False)
    return figure


def table(header, lines):
    def row(cells, tag):
        return "<tr>" + "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    return "<table>" + row(header, "th") + "".join(row(line, "td") for line in lines) + "</table>"


def summary(name, rows):
    flights = [row["last_arrival_s"] for row in rows if row["result"] == "success"]
    return [*name, len(rows), *(f"{share(rows, result):.1f}" for result in COLORS),
            sum("-robot " in row["touches"] for row in rows), f"{statistics.mean(flights):.2f}" if flights else "-"]


def page(path, rows, figures):
    cells = [summary(key, cell) for key, cell in grouped(rows, "task", "env", "obstacles").items()]
    cells.append(summary(("all", "", ""), rows))
    failures = [row for row in rows if row["result"] != "success"]
    text = [f"<!doctype html><meta charset='utf-8'><title>{html.escape(path.name)}</title>", STYLE,
            f"<h1>{len(rows)} flights, {share(rows, 'success'):.1f} % success</h1>",
            f"<p>{html.escape(path.name)}: {share(rows, 'collision'):.1f} % touched something, {share(rows, 'stuck'):.1f} % "
            "did not all arrive. A robot is a sphere; touching is judged by exact geometry every 10 ms.</p>"]
    text += [f"<figure>{svg}</figure>" for svg in figures]
    text.append("<h2>By task, environment and number of obstacles</h2>")
    text.append(table(["task", "env", "obstacles", "trials", "success %", "collision %", "stuck %", "robot touches", "last arrival s"], cells))
    text.append(f"<h2>{len(failures)} failures, and the command that repeats each with trace and logs</h2>")
    text.append(table(["trial", "outcome", "touched", "command"], [[r["trial"], r["outcome"], r["touches"], r["command"]] for r in failures]))
    return "\n".join(text) + "\n"


STYLE = """<style>
body { font: 15px/1.45 sans-serif; max-width: 1100px; margin: 2em auto; padding: 0 1em; color: #222 }
figure { margin: 1.5em 0 } svg { max-width: 100%; height: auto }
table { border-collapse: collapse; font-size: 13px } th, td { padding: 3px 9px; border-bottom: 1px solid #ddd; text-align: right }
th:first-child, td:first-child, td:last-child { text-align: left }
</style>"""


def main(results, directory):
    path, out = pathlib.Path(results), pathlib.Path(directory)
    rows = read_rows(path)
    out.mkdir(parents=True, exist_ok=True)
    drawn = []
    for name, draw in [("success", draw_success), ("flight_time", draw_flight_time), ("planning_time", draw_planning_time)]:
        figure = draw(rows)
        figure.savefig(out / f"{name}.png", dpi=150, bbox_inches="tight")
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", bbox_inches="tight", metadata={"Date": None})
        plt.close(figure)
        (out / f"{name}.svg").write_text(buffer.getvalue(), encoding="utf-8")
        svg = buffer.getvalue()
        drawn.append(svg[svg.index("<svg"):])
    (out / "report.html").write_text(page(path, rows, drawn), encoding="utf-8")
    print(f"report: {len(rows)} flights, {share(rows, 'success'):.1f} % success: {out / 'report.html'}")


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except (BadInput, OSError, UnicodeDecodeError) as error:
        print(f"report: {error}", file=sys.stderr)
        sys.exit(2)
