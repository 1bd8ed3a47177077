// Figures of all robots over the last minute, as lines in the robots' colours: gathered from the frames as they come.
"use strict";

const PLOT_SPANS_S = [10, 20, 60];  // what is shown: the first that holds what there is
const PLOT_STEP_S = 0.1;            // the least time between two samples
const PLOT_GAP_S = 1.5;             // a longer time without samples breaks the line
const SILENT_S = 2.5;               // statuses come once a second
const LONGEST_SPAN_S = PLOT_SPANS_S[PLOT_SPANS_S.length - 1];

// From a point to the surface of an obstacle; within a box or a column 0.
function distanceTo(obstacle, point) {
  const [dx, dy, z] = point.map((coordinate, axis) => coordinate - obstacle.position[axis]);
  const cos = Math.cos(obstacle.yaw), sin = Math.sin(obstacle.yaw);
  const x = cos * dx + sin * dy, y = cos * dy - sin * dx;  // turned with it
  const [a, b, c] = obstacle.size;
  const beyond = (coordinate, size) => Math.max(0, Math.abs(coordinate) - size / 2);
  if (obstacle.shape === "ring") return Math.hypot(Math.hypot(y, z) - a, x) - b / 2;
  if (obstacle.shape === "box") return Math.hypot(beyond(x, a), beyond(y, b), beyond(z, c));
  if (obstacle.shape === "sphere") return Math.hypot(x, y, z) - a / 2;
  return Math.hypot(beyond(Math.hypot(x, y), a), beyond(z, b));
}

// Of a robot's hull to the nearest obstacle or robot; undefined: there is none.
function clearance(robot, frame) {
  if (!robot.position) return undefined;
  const others = frame.robots.filter((other) => other !== robot && other.position).map((other) =>
    Math.hypot(...other.position.map((coordinate, axis) => coordinate - robot.position[axis])) - (other.radius || 0));
  const least = Math.min(...others, ...frame.obstacles.map((obstacle) => distanceTo(obstacle, robot.position)));
  return Number.isFinite(least) ? least - (robot.radius || 0) : undefined;
}

// Whether what a robot said lately includes this; and where it is.
const says = (robot, channel) => Boolean(robot.traffic[channel]) && robot.traffic[channel].age_s < SILENT_S;
const isHeard = (robot) => robot.announcement_age_s < SILENT_S || says(robot, "ROBOT_STATE");

// `limit`: what is above it is of no interest.
const PLOTS = [
  { name: "speed", title: "Speed", unit: "m/s", digits: 2, of: (robot) => isHeard(robot) ? robot.speed : undefined },
  { name: "clearance", title: "Clearance", unit: "m", digits: 2, limit: 2,
    of: (robot, frame) => isHeard(robot) ? clearance(robot, frame) : undefined,
    help: "from the robot's hull to the nearest obstacle or robot that is known; walls do not count" },
  { name: "planning", title: "Planning", unit: "ms", digits: 2, help: "how long the newest plan took; a run in lock-step does not tell",
    of: (robot) => says(robot, "PLANNER_STATUS") && robot.planner.total_ms > 0 ? robot.planner.total_ms : undefined },
  { name: "network", title: "Peers' oldest news", unit: "ms", digits: 0, help: "how old the newest announcement is of the peer that was heard of longest ago",
    of: (robot) => says(robot, "BROADCAST_STATUS") && robot.broadcast.peers_heard > 0 ? robot.broadcast.max_age_ms : undefined },
];

// The least of 1, 1.5, 2, 3, 5, 10, 15, ... (and of tenths) that is no less.
function roundedUp(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 1.5, 2, 3, 5, 10].find((factor) => factor * power >= 0.999 * value);
}

class Plots {
  constructor(root) {
    this.samples = [];  // of one time each, the oldest first: {t, values: Map of a robot's figures by its id}
    this.views = PLOTS.map((plot) => {
      const view = { plot: plot, value: document.createElement("span"), canvas: document.createElement("canvas") };
      const box = document.createElement("div"), head = document.createElement("div"), title = document.createElement("b");
      box.className = "plot box";
      box.title = plot.help || "";
      title.textContent = plot.title;
      head.append(title, view.value);
      box.append(head, view.canvas);
      root.append(box);
      return view;
    });
  }

  // What is later than the frame goes: a log went back.
  add(frame) {
    const t = 1e-6 * frame.utime;
    while (this.samples.length > 0 && this.samples[this.samples.length - 1].t > t) this.samples.pop();
    if (this.samples.length > 0 && t < this.samples[this.samples.length - 1].t + PLOT_STEP_S) return;
    this.samples.push({ t: t, values: new Map(frame.robots.map((robot) => [robot.id, PLOTS.map((plot) => plot.of(robot, frame))])) });
    while (this.samples[0].t < t - LONGEST_SPAN_S) this.samples.shift();
  }

  // A robot's figures of one plot, as [time, value]; a gap as undefined.
  series(id, index) {
    const points = [];
    let before = -Infinity;
    for (const { t, values } of this.samples) {
      const value = values.has(id) ? values.get(id)[index] : undefined;
      if (value === undefined || t > before + PLOT_GAP_S) points.push(undefined);
      if (value !== undefined) points.push([t, value]);
      before = t;
    }
    return points;
  }

  draw(ids, selected) {
    this.views.forEach((view, index) => {
      const all = ids.map((id) => ({ id: id, points: this.series(id, index) }));
      this.drawOne(view, all, selected);
      const shown = all.find((one) => one.id === selected);
      const newest = shown && shown.points[shown.points.length - 1];
      view.value.textContent = newest ? newest[1].toFixed(view.plot.digits) + " " + view.plot.unit : "-";
    });
  }

  drawOne({ plot, canvas }, all, selected) {
    const scale = window.devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = scale * width;  // which clears it
    canvas.height = scale * height;
    const values = all.flatMap((one) => one.points.filter(Boolean).map((point) => point[1]));
    const top = roundedUp(Math.min(plot.limit || Infinity, values.reduce((most, value) => Math.max(most, value), 0)));
    const [begin, end] = this.samples.length > 0 ? [this.samples[0].t, this.samples[this.samples.length - 1].t] : [0, 0];
    const span = PLOT_SPANS_S.find((seconds) => seconds >= end - begin) || LONGEST_SPAN_S;
    const left = 26, right = width - 4, low = height - 14, high = 5;
    const x = (t) => right - (right - left) * (end - t) / span;
    const y = (value) => low - (low - high) * Math.min(Math.max(value / top, -0.05), 1);
    const context = canvas.getContext("2d");
    context.scale(scale, scale);
    context.font = "10px system-ui, sans-serif";
    context.fillStyle = "#66727d";
    context.strokeStyle = "#d5dbe0";
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const value of [0, top / 2, top]) {
      context.fillText(String(Number(value.toPrecision(3))), left - 4, y(value));
      context.beginPath();
      context.moveTo(left, y(value));
      context.lineTo(right, y(value));
      context.stroke();
    }
    context.fillText("now", right, height - 5);
    context.textAlign = "left";
    context.fillText("-" + span + " s", left, height - 5);
    context.lineJoin = "round";
    const last = (one) => Number(one.id === selected);  // on top
    for (const { id, points } of [...all].sort((one, other) => last(one) - last(other))) {
      context.strokeStyle = robotColor(id);
      context.lineWidth = id === selected ? 2.2 : 1.1;
      context.beginPath();
      let pen = false;
      for (const point of points) {
        if (point) pen ? context.lineTo(x(point[0]), y(point[1])) : context.moveTo(x(point[0]), y(point[1]));
        pen = Boolean(point);
      }
      context.stroke();
    }
  }
}
