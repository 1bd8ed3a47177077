"""Draws a run, seen from above, as an animated SVG: small, sharp at any size, and it moves wherever a browser shows a picture.

Used by run_plot.py, which reads the run: every moving thing is a shape whose places are listed by time, as few as keep it
within a fifth of a pixel of where it was.
"""

import html

import numpy as np

PIXELS_PER_M = 36
WIDEST = 480  # pixels that a page gives it; drawn finer, so that it can be looked at larger
TOLERANCE = 0.2 / PIXELS_PER_M  # [m]
STEP = 2  # of the trace's steps of 10 ms
COLORS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#e377c2", "#8c564b")
STYLE = """
text { font: 15px sans-serif; fill: #404852 } .grid { stroke: #e6e9ee } .column { fill: #c3c9d2; stroke: #8f98a6 }
.ring { fill: #e8b35a; stroke: #b98224 } .way { fill: none; stroke-width: 2.5; stroke-linejoin: round; opacity: 0.5 }
.goal { fill: none; stroke-width: 2 } .robot { stroke: white; stroke-width: 1.5 }"""


def key_steps(times, points):
    """Steps between which a straight line at constant speed keeps all points within the tolerance; the first and the last as well."""
    keys, first = [0], 0
    while first < len(times) - 1:
        last, reach = first + 1, 2
        while reach > 0:  # doubles, then halves the step, for as long as the line between fits
            end = min(last + reach, len(times) - 1)
            share = ((times[first : end + 1] - times[first]) / (times[end] - times[first]))[:, None]
            line = points[first] + share * (points[end] - points[first])
            fits = end > last and np.max(np.linalg.norm(line - points[first : end + 1], axis=1)) <= TOLERANCE
            last, reach = (end, 2 * reach) if fits else (last, reach // 2)
        first = last
        keys.append(first)
    return keys


def animate(attribute, seconds, times, values, kind="animate", extra=""):
    shares = ";".join(f"{share:.4g}" for share in (times - times[0]) / (times[-1] - times[0]))
    return f'<{kind} attributeName="{attribute}" {extra}dur="{seconds:.2f}s" repeatCount="indefinite" keyTimes="{shares}" values="{";".join(values)}"/>'


def moving(shape, seconds, times, points):
    """A shape drawn around 0, 0; it is not shown while its place is NaN."""
    there = ~np.isnan(points[:, 0])
    if not there.any():
        return ""
    hidden = ""
    if not there.all():
        changes = [0, *(np.flatnonzero(there[1:] != there[:-1]) + 1), len(times) - 1]
        hidden = animate("opacity", seconds, times[changes], [str(int(there[k])) for k in changes], extra='calcMode="discrete" ')
        points = np.column_stack([np.interp(times, times[there], points[there, k]) for k in (0, 1)])
    keys = key_steps(times, points)
    places = [f"{x:.1f},{y:.1f}" for x, y in PIXELS_PER_M * points[keys]]
    moves = animate("transform", seconds, times[keys], places, "animateTransform", 'type="translate" ')
    return f'<g transform="translate({places[0]})">{shape}{hidden}{moves}</g>'


def outline(obstacle):
    shape, yaw = obstacle["shape"], np.degrees(obstacle.get("yaw", 0.0))
    if shape in ("column", "sphere"):
        return f'<circle class="column" r="{PIXELS_PER_M * obstacle["diameter"] / 2:.1f}"/>'
    length, width = obstacle["size"][:2] if shape == "box" else (obstacle["width"], 2 * obstacle["radius"] + obstacle["width"])
    length, width = PIXELS_PER_M * length, PIXELS_PER_M * width
    kind, corner = ("column", 0) if shape == "box" else ("ring", length / 2)
    return f'<rect class="{kind}" x="{-length / 2:.1f}" y="{-width / 2:.1f}" width="{length:.1f}" height="{width:.1f}" rx="{corner:.1f}" transform="rotate({yaw:.1f})"/>'


def robot_shapes(run, i, color, seconds, steps):
    """(its way so far, its goals, itself)."""
    trace = run.traces[i][steps]
    times, points = trace[:, 0], trace[:, 2:4]
    keys = key_steps(times, points)
    corners = PIXELS_PER_M * points[keys]
    ways = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    length = ways[-1] + 1
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    offsets = animate("stroke-dashoffset", seconds, times[keys], [f"{length - way:.1f}" for way in ways])
    radius = PIXELS_PER_M * run.robots[i]["radius"]
    goals = [
        f'<circle class="goal" stroke="{color}" r="{1.6 * radius:.1f}" cx="{PIXELS_PER_M * goal[0]:.1f}" cy="{PIXELS_PER_M * goal[1]:.1f}"/>' for goal in run.goals[i]
    ]
    return (
        f'<polyline class="way" stroke="{color}" stroke-dasharray="{length:.1f}" stroke-dashoffset="{length:.1f}" points="{line}">{offsets}</polyline>',
        "".join(goals),
        moving(f'<circle class="robot" fill="{color}" r="{radius:.1f}"/>', seconds, times, points),
    )


def clock(seconds, times, low, high):
    """Whole seconds, one text each, shown in its turn."""
    x, y = PIXELS_PER_M * (low[0] + 0.3), -PIXELS_PER_M * (high[1] - 0.6)
    texts, first, last = [], times[0], times[-1]
    for second in range(int(np.ceil(last - first))):
        turn = np.array([first, first + second, min(first + second + 1, last), last]) if second else np.array([first, first, first + 1, last])
        shown = animate("opacity", seconds, turn, ["0", "1", "0", "0"], extra='calcMode="discrete" ')
        texts.append(f'<text x="{x:.0f}" y="{y:.0f}" opacity="{int(second == 0)}">{second} s{shown}</text>')
    return texts


def animation(run, out, speed):
    steps = np.arange(0, len(run.t), STEP)
    times = run.t[steps]
    seconds = (times[-1] - times[0]) / speed
    low, high = (np.array(run.world["space"][side][:2]) + grow for side, grow in (("min", -0.8), ("max", 0.8)))
    (left, top), (width, height) = PIXELS_PER_M * np.array([low[0], -high[1]]), PIXELS_PER_M * (high - low)
    shown = WIDEST / max(width, height) * np.array([width, height])
    lines = [f'<path class="grid" d="M{PIXELS_PER_M * x},{-top:.0f}V{-top - height:.0f}"/>' for x in range(2 * int(np.ceil(low[0] / 2)), int(high[0]) + 1, 2)]
    lines += [f'<path class="grid" d="M{left:.0f},{PIXELS_PER_M * y}H{left + width:.0f}"/>' for y in range(2 * int(np.ceil(low[1] / 2)), int(high[1]) + 1, 2)]
    walls = [
        f'<rect class="column" x="{x:.1f}" y="{y:.1f}" width="{length:.1f}" height="{width:.1f}"/>'
        for (x, y, _), (length, width, _) in ((PIXELS_PER_M * np.array(wall["min"]), PIXELS_PER_M * np.subtract(wall["max"], wall["min"])) for wall in run.walls)
    ]
    obstacles = [moving(outline(obstacle), seconds, times, run.obstacle_at(obstacle, times)[0][:, :2]) for obstacle in run.obstacles]
    robots = [robot_shapes(run, i, COLORS[n % len(COLORS)], seconds, steps) for n, i in enumerate(run.robots)]
    layers = [*lines, *walls, *obstacles, *(shape for layer in zip(*robots) for shape in layer)]
    text = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{shown[0]:.0f}" height="{shown[1]:.0f}" viewBox="{left:.0f} {top:.0f} {width:.0f} {height:.0f}">',
        f"<title>{html.escape(run.report['world'])}: {len(run.robots)} robots, {len(run.obstacles)} obstacles, seen from above</title><style>{STYLE}</style>",
        f'<rect x="{left:.0f}" y="{top:.0f}" width="{width:.0f}" height="{height:.0f}" rx="12" fill="#f8f9fb"/>',
        '<g transform="scale(1,-1)">',  # y points up
        *layers,
        "</g>",
        *clock(seconds, times, low, high),
        "</svg>\n",
    ]
    out.write_text("\n".join(text), encoding="utf-8")
