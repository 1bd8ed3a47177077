"""Draws what `planner_bench --growth` measured: the time of a plan against each kind of work, on logarithmic axes.

Called by tools/bench as: growth_plot.py GROWTH.csv FIGURE.svg
"""

import csv
import sys

import matplotlib

matplotlib.use("Agg")
matplotlib.rcParams.update({"font.size": 9, "svg.hashsalt": "sogm_swarm", "axes.spines.top": False, "axes.spines.right": False})
import matplotlib.pyplot as plt  # noqa: E402

LABELS = {"obstacles": "obstacles in the map", "peers": "peers", "horizon_s": "horizon [s]", "resolution_m": "edge of a voxel [m]"}


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    figure, axes = plt.subplots(1, len(LABELS), figsize=(11, 2.8), sharey=True)
    for axis, (work, label) in zip(axes, LABELS.items()):
        series = [row for row in rows if row["work"] == work]
        values = [float(row["value"]) for row in series]
        axis.plot(values, [float(row["p50_ms"]) for row in series], "o-", label="median")
        axis.plot(values, [float(row["p95_ms"]) for row in series], "s--", color="#888888", label="95 %")
        axis.set(xscale="log", yscale="log", xlabel=label, title=f"exponent {float(series[0]['exponent']):.2f}")
        axis.set_xticks(values, [row["value"] for row in series])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("time of a plan [ms]")
    axes[0].set_yticks([0.2, 0.5, 1, 2, 5], ["0.2", "0.5", "1", "2", "5"])
    axes[0].legend(frameon=False)
    figure.savefig(sys.argv[2], bbox_inches="tight", metadata={"Date": None})


if __name__ == "__main__":
    main()
