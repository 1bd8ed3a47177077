"""Draws what tools/identify found: where a vehicle was told to be, where it was and where the model says, one flight; and how far
from the setpoints it was, and will be.

Called by tools/identify as: identify_plot.py DIR (DIR/identified.csv to DIR/identified.svg and .png)
"""

import csv
import math
import os
import sys

import matplotlib

matplotlib.use("Agg")
matplotlib.rcParams.update({"font.size": 9, "svg.hashsalt": "sogm_swarm", "axes.spines.top": False, "axes.spines.right": False})
import matplotlib.pyplot as plt  # noqa: E402

SHOWN_S = 8.0
SERIES = (("told", "told", "#888888", "--"), ("seen", "measured", "#1f77b4", "-"), ("model", "model", "#d62728", ":"))


def distance(row, who):
    return math.dist([float(row[f"{who}_{axis}"]) for axis in "xyz"], [float(row[f"told_{axis}"]) for axis in "xyz"])


def main():
    directory = sys.argv[1]
    with open(os.path.join(directory, "identified.csv"), encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    figure, (places, distances) = plt.subplots(1, 2, figsize=(11, 3.2), width_ratios=(2, 1))
    flight = [row for row in rows if row["flight"] == rows[0]["flight"]]
    flight = [row for row in flight if float(row["time_s"]) <= float(flight[0]["time_s"]) + SHOWN_S]
    times = [float(row["time_s"]) for row in flight]
    for who, label, colour, style in SERIES:
        places.plot(times, [float(row[f"{who}_x"]) for row in flight], style, color=colour, label=label)
        places.plot(times, [float(row[f"{who}_y"]) for row in flight], style, color=colour)
    places.set(xlabel="time [s]", ylabel="x, y [m]", title="the first flight")
    places.legend(frameon=False)
    shares = [100 * i / max(1, len(rows) - 1) for i in range(len(rows))]
    for who, label, colour in (("seen", "measured", "#1f77b4"), ("model", "model", "#d62728"), ("fitted", "model, as recommended", "#2ca02c")):
        distances.plot(sorted(distance(row, who) for row in rows), shares, color=colour, label=label)
    distances.set(xlabel="distance from the setpoints [m]", ylabel="nearer than that [%]", ylim=(0, 101), title="all flights")
    distances.legend(frameon=False)
    for axis in (places, distances):
        axis.grid(alpha=0.3)
    for ending in ("svg", "png"):
        metadata = {"Date": None} if ending == "svg" else {}
        figure.savefig(os.path.join(directory, f"identified.{ending}"), bbox_inches="tight", metadata=metadata)


if __name__ == "__main__":
    main()
