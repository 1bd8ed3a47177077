// The page: takes the frames of the stream, draws them, shows how the daemons are doing, and tells what the user wants.
"use strict";

const element = (id) => document.getElementById(id);
const scene = new SwarmScene(), plots = new Plots(element("plots")), mission = new MissionEditor(scene);
const STILL_PIXELS = 4;       // that the mouse may move in a click
const ERROR_SHOWN_MS = 10000;
const MOST_AWAY_M = 500;      // from the camera, of a place that is clicked: nothing beyond is drawn
const wish = { select: null, frame: -1 };  // whose SOGM and corridors, and which frame of it
let socket = null, frame = null, fps = 0, arrived = [], dragging = false, chosen = false, aimedAt = 0, cards = new Map(),
  cardsDrawn = 0, error = { number: 0, text: "", since: 0 };

// Whether there is somebody to tell.
function tell(command) {
  const isOpen = Boolean(socket) && socket.readyState === WebSocket.OPEN;
  if (isOpen) socket.send(JSON.stringify(command));
  return isOpen;
}

function connect() {
  socket = new WebSocket("ws://" + location.host + "/stream");
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    error.number = 0;  // the server counts from the beginning again
    tell(wish);
  };
  socket.onmessage = (event) => take(event.data);
  socket.onclose = () => {
    element("state").textContent = "No connection; trying again ...";
    setTimeout(connect, 1000);
  };
}

// See picture_frame.h for the layout.
function take(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  frame = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const numbers = (place, Numbers = Float32Array) => new Numbers(buffer, 4 + length + place.at, place.count);
  const now = performance.now();
  arrived.push(now);
  while (arrived[0] < now - 2000) arrived.shift();
  fps = (arrived.length - 1) / Math.max(1, 1e-3 * (now - arrived[0]));

  if (frame.error && frame.error.number !== error.number) error = { ...frame.error, since: now };
  plots.add(frame);
  scene.setRobots(frame.robots, numbers);
  aim();
  scene.setObstacles(frame.obstacles);
  scene.obstacleGroup.visible = element("show-obstacles").checked;
  if (frame.static_map) scene.walls.set(numbers(frame.static_map.cubes));
  if (frame.selected === null) scene.forgetSelected();
  if (frame.sogm) {
    scene.setSogm(frame.sogm, numbers);
    element("frame").max = Math.max(0, frame.sogm.num_frames - 1);
    element("horizon").textContent = "+" + (frame.sogm.num_frames * frame.sogm.frame_duration_s).toFixed(1) + " s";
  }
  if (frame.corridors) scene.setCorridors(frame.corridors, numbers);
  if (frame.seen_space) scene.setSeenSpace(frame.seen_space, numbers);
  if (frame.scans) scene.setScans(frame.scans, numbers);
  scene.voxels.mesh.visible = element("show-sogm").checked && scene.voxels.count > 0;
  scene.corridors.visible = element("show-corridors").checked && frame.selected !== null;
  scene.sight.visible = element("show-sight").checked;
  scene.masks.visible = frame.selected !== null;
  const followed = frame.robots.find((robot) => robot.id === wish.select);
  if (element("follow").checked && followed && followed.position) scene.follow(followed.position);
  if (!chosen) {  // the first robot that has a map
    const first = frame.robots.find((robot) => robot.has_sogm);
    if (first) select(first.id);
  }
  if (now - cardsDrawn > 200) {
    cardsDrawn = now;
    describe();
  }
}

const allPlaces = () => frame.robots.flatMap((robot) => [robot.position, robot.goal].filter(Boolean));

// At all robots and goals, as they come to be known, until the user turns the picture.
function aim() {
  const places = allPlaces();
  if (places.length <= aimedAt) return;
  aimedAt = places.length;
  scene.aim(places);
}

function lookAt(places) {
  aimedAt = Infinity;
  scene.aim(places);
}
const lookAtAll = () => { if (frame) lookAt(allPlaces()); };
function lookAtChosen() {
  if (!frame) return;
  const robot = frame.robots.find((one) => one.id === wish.select);
  const robots = robot ? [robot] : frame.robots;
  lookAt(robots.map((one) => one.position).filter(Boolean));
}

function select(id) {
  chosen = true;
  if (id !== wish.select) scene.forgetSelected();  // who has no sensors, or no map, sends none in their place
  wish.select = id;
  tell(wish);
  mission.select(id);
  describe();
}

// How the daemons are doing.
function describe() {
  if (!frame) return;
  const isNews = performance.now() < error.since + ERROR_SHOWN_MS;
  const messages = [frame.warning, isNews && error.text].filter(Boolean);
  const heard = frame.robots.length;
  let state;
  if (frame.mode === "log") {
    state = frame.names.length === 1 ? frame.names[0].split("/").pop() : frame.names.length + " logs";
    if (frame.damaged_bytes > 0) messages.push(frame.damaged_bytes + " bytes of the log are no events.");
  } else {
    state = heard ? "live, " + heard + (heard === 1 ? " robot" : " robots") : "live";
    if (frame.messages === 0) messages.push("Nothing heard yet on " + frame.buses.map((bus) => bus.url.split("?")[0]).join(", "));
  }
  if (frame.refused > 0) messages.push(frame.refused + " messages could not be read.");
  element("state").textContent = state + ", " + fps.toFixed(0) + " frames/s";
  element("message").textContent = messages.join(" ");
  element("orders").hidden = !frame.allow_goals;
  element("sight-row").hidden = !frame.robots.some((robot) => robot.has_sensors);
  element("plots").hidden = !element("show-plots").checked;
  if (element("show-plots").checked) plots.draw(frame.robots.map((robot) => robot.id), wish.select);
  describeChoice();
  describePlayer();
  for (const id of [...cards.keys()]) {
    if (frame.robots.some((robot) => robot.id === id)) continue;
    cards.get(id).root.remove();
    cards.delete(id);
  }
  for (const robot of frame.robots) describeRobot(robot);
}

function describeChoice() {
  const box = element("select"), ids = frame.robots.map((robot) => String(robot.id)), wanted = ["none", ...ids];
  if ([...box.options].map((option) => option.value).join() !== wanted.join()) {
    box.replaceChildren(...wanted.map((name) => new Option(name === "none" ? "nobody" : "robot " + name, name)));
  }
  box.value = wish.select === null ? "none" : String(wish.select);
  element("frame-text").textContent = wish.frame < 0 ? "all" : String(wish.frame);
}

function describePlayer() {
  element("player").style.display = frame.mode === "log" ? "flex" : "none";
  if (frame.mode !== "log") return;
  const slider = element("slider");
  slider.max = frame.length_s;
  if (!dragging) slider.value = frame.at_s;
  element("play").textContent = frame.playing ? "Pause" : "Play";
  element("time").textContent = frame.at_s.toFixed(2) + " / " + frame.length_s.toFixed(2) + " s";
}

const counts = (what) => Object.entries(what).map(([name, count]) => name + " " + count).join(", ");

// Rows of a robot's table: name, text, whether it is bad.
function rows(robot) {
  const all = [];
  const { planner, map, broadcast, perception } = robot;
  if (planner) {
    all.push(["plans", planner.rate_hz.toFixed(1) + " /s, " + planner.outcome, planner.outcome === "unsafe"]);
    if (planner.total_ms > 0) all.push(["planning", planner.total_ms.toFixed(2) + " ms", false]);
    if (planner.margin_m > 0) all.push(["margin", planner.margin_m.toFixed(2) + " m", false]);
    if (planner.missed > 0) all.push(["maps missed", planner.missed, false]);
  }
  if (map) all.push(["map", map.rate_hz.toFixed(1) + " /s" + (map.build_ms > 0 ? ", " + map.build_ms.toFixed(2) + " ms" : ""), false]);
  if (perception) {
    all.push(["scans", perception.rate_hz.toFixed(1) + " /s" + (perception.scan_ms > 0 ? ", " + perception.scan_ms.toFixed(2) + " ms" : ""), false]);
    all.push(["sees", perception.moving + " move, " + perception.standing + " stand", false]);
    all.push(["points", perception.points + ", " + perception.masked + " on robots", false]);
    if (perception.jumps > 0) all.push(["pose jumped", perception.jumps, true]);
    if (perception.blind > 0) all.push(["saw nothing", perception.blind, true]);
    if (perception.map !== "none") all.push(["kept map", perception.map, perception.map !== "kept"]);
  }
  if (broadcast) {
    all.push(["commits", broadcast.commits + " of " + broadcast.candidates, false]);
    if (broadcast.forced > 0) all.push(["forced", broadcast.forced, true]);
    if (Object.keys(broadcast.rejected).length > 0) all.push(["rejected", counts(broadcast.rejected), false]);
    if (broadcast.tracking_error_m > 0.005) all.push(["off its motion", broadcast.tracking_error_m.toFixed(2) + " m", broadcast.tracking_error_m > 0.3]);
    all.push(["peers", broadcast.peers_heard + ", oldest " + broadcast.max_age_ms.toFixed(0) + " ms", false]);
    if (broadcast.lost > 0) all.push(["lost", broadcast.lost + " announcements", false]);
    if (Math.abs(broadcast.max_clock_offset_ms) > 5) all.push(["clock", broadcast.max_clock_offset_ms.toFixed(1) + " ms off", true]);
  }
  if (robot.announcement_age_s !== undefined) all.push(["announced", robot.announcement_age_s.toFixed(2) + " s ago", robot.announcement_age_s > 0.5]);
  if (robot.battery !== undefined) all.push(["battery", (100 * robot.battery).toFixed(0) + " %", robot.battery < 0.2]);
  if (robot.speed !== undefined) all.push(["speed", robot.speed.toFixed(2) + " m/s", false]);
  for (const [daemon, status] of [["map", map], ["planner", planner], ["broadcast", broadcast], ["perception", perception]]) {
    if (status && Object.keys(status.refused).length > 0) all.push([daemon + " refused", counts(status.refused), true]);
  }
  return all;
}

function describeRobot(robot) {
  let card = cards.get(robot.id);
  if (!card) {
    card = { root: document.createElement("div"), name: document.createElement("b"), health: document.createElement("span"), table: document.createElement("table") };
    card.root.className = "robot";
    card.root.style.borderLeftColor = robotColor(robot.id);
    card.name.textContent = "Robot " + robot.id;
    card.health.className = "health";
    card.root.append(card.name, card.health, card.table);
    card.root.onclick = () => select(robot.id);
    cards.set(robot.id, card);
    const later = [...cards.keys()].filter((id) => id > robot.id).sort((a, b) => a - b)[0];
    element("robots").insertBefore(card.root, later === undefined ? null : cards.get(later).root);
  }
  const trouble = robot.trouble;
  card.health.textContent = trouble || robot.activity;
  card.health.classList.toggle("bad", trouble !== "");
  card.root.classList.toggle("selected", robot.id === wish.select);
  const shown = rows(robot);
  while (card.table.rows.length > shown.length) card.table.deleteRow(-1);
  while (card.table.rows.length < shown.length) {
    const row = card.table.insertRow();
    row.insertCell();
    row.insertCell();
  }
  shown.forEach(([name, text, bad], i) => {
    card.table.rows[i].cells[0].textContent = name;
    card.table.rows[i].cells[1].textContent = text;
    card.table.rows[i].cells[1].classList.toggle("bad", bad);
  });
}

element("select").onchange = (event) => select(event.target.value === "none" ? null : Number(event.target.value));
element("frame").oninput = (event) => {
  wish.frame = Number(event.target.value);
  tell(wish);
  describe();
};
element("slider").oninput = (event) => {
  dragging = true;
  tell({ seek: Math.min(Number(event.target.value), frame.length_s) });
};
element("slider").onchange = () => { dragging = false; };
element("play").onclick = () => tell({ play: !frame.playing });
element("speed").onchange = (event) => tell({ speed: Number(event.target.value) });
element("show-plots").onchange = () => describe();

// Like a refusal by the server.
function refuse(text) {
  error = { ...error, text: text, since: performance.now() };
  describe();
  return null;
}

// Where the mouse is in the scene, at the height that was set, to the centimetre; null: nowhere, and it is said.
function pointOf(event) {
  const height = element("height").valueAsNumber;  // NaN while it is empty
  if (!Number.isFinite(height)) return refuse("height of goals: must be a number");
  const point = scene.pointAt(event.clientX, event.clientY, height);
  const isNear = point && point.distanceTo(scene.camera.position) <= MOST_AWAY_M;
  return isNear ? point.toArray().map(hundredths) : refuse("no place at that height within " + MOST_AWAY_M + " m");
}
let pressed = [0, 0];
scene.renderer.domElement.addEventListener("mousedown", (event) => { pressed = [event.clientX, event.clientY]; });
scene.renderer.domElement.addEventListener("click", (event) => {
  const isStill = Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) <= STILL_PIXELS;  // else it turned the view
  if (!isStill || !canGiveOrders() || !mission.isOpen || wish.select === null) return;
  const point = pointOf(event);
  if (point) mission.add(point);
});
scene.renderer.domElement.addEventListener("dblclick", (event) => {
  if (!canGiveOrders() || mission.isOpen || wish.select === null) return;
  const point = pointOf(event);
  if (point) tell({ goal: { robot: wish.select, waypoints: [{ position: point }] } });
});

// An order to the robot that is looked at, or to all; what cannot be taken back is asked for first.
for (const button of element("orders").querySelectorAll("[data-order]")) {
  button.onclick = (event) => {
    event.preventDefault();
    const name = button.dataset.order, all = element("order-all").checked;
    const robots = all ? frame.robots.map((robot) => robot.id) : [wish.select].filter((id) => id !== null);
    if (robots.length === 0) return;
    const whom = all ? "all robots" : "robot " + robots[0];
    if (name === "emergency" && !window.confirm("Emergency: " + whom + " shall stop and come down where they are?")) return;
    tell({ order: { robots: robots, name: name, height: Number(element("height").value) } });
  };
}

// What is on the screen, for tests.
window.shown = () => ({
  utime: frame && frame.utime,
  mode: frame && frame.mode,
  at_s: frame && frame.at_s,
  fps: fps,
  robots: [...scene.robots].filter(([, robot]) => robot.body.visible).map(([id, robot]) => ({
    id: id, position: robot.body.position.toArray(), goal: robot.goal.visible ? robot.goal.position.toArray() : null,
    trajectory: robot.lines.committed.visible,
  })),
  obstacles: scene.obstacles.size,
  voxels: scene.voxels.mesh.visible ? scene.voxels.count : 0,
  corridors: scene.corridors.visible ? scene.edges.geometry.attributes.position.count / 2 : 0,
  walls: scene.walls.count,
  scan: scene.sight.visible ? scene.scan.count : 0,
  standing: scene.sight.visible ? scene.standing.count : 0,
  masks: scene.masks.visible && scene.sight.visible ? scene.masks.children.filter((ball) => ball.visible).length : 0,
  uncertain: [...scene.obstacles.values()].filter((obstacle) => obstacle.shell.visible).length,
  selected: wish.select,
  state: element("state").textContent,
  message: element("message").textContent,
  cards: [...cards.values()].map((card) => card.root.innerText),
  names: scene.names,
  samples: PLOTS.map((plot, i) => [plot.name, frame ? frame.robots.map((robot) => plots.series(robot.id, i).filter(Boolean).length) : []]),
  waypoints: mission.isOpen && wish.select !== null ? mission.draft().waypoints : [],
  marks: mission.drawn.children.filter((part) => part.isMesh).length,
  camera: { position: scene.camera.position.toArray(), target: scene.controls.target.toArray() },
  memory: { ...scene.renderer.info.memory },
});

scene.controls.addEventListener("start", () => { aimedAt = Infinity; });

(function animate() {
  requestAnimationFrame(animate);
  scene.draw();
})();
connect();
