// The mission editor: waypoints for the robot that is looked at, a list of them and how they lie in the scene, until they
// are sent as one goal. Every robot keeps its list until it is cancelled.
"use strict";

const MOST_WAYPOINTS = 50;  // so that they fit a message to the server
const MOST_PLACES = 1000;   // with repetitions: goal_t.kMaxWaypoints
const WAYPOINT_FIELDS = [   // columns of the list
  { name: "x", step: 0.1, least: -1e5, most: 1e5 },
  { name: "y", step: 0.1, least: -1e5, most: 1e5 },
  { name: "z", step: 0.1, least: -1e5, most: 1e5 },
  { name: "wait_s", step: 1, least: 0, most: 86400 },
];

// To the centimetre, or the hundredth of a second: more digits would make a mission too long for a message.
const hundredths = (value) => Math.round(100 * value) / 100;

class MissionEditor {
  constructor(scene) {
    this.scene = scene;
    this.drafts = new Map();  // by robot: {waypoints: [{x, y, z, wait_s}], times}
    this.robot = null;
    this.isOpen = false;
    this.drawn = new THREE.Group();
    scene.scene.add(this.drawn);
    element("mission-edit").onclick = () => this.isOpen ? this.close() : this.open();
    element("mission-send").onclick = () => this.send();
    element("mission-cancel").onclick = () => this.cancel();
    element("times").onchange = (event) => {
      if (event.target.value !== "" && event.target.checkValidity()) this.draft().times = Number(event.target.value);
      this.showChange();
    };
  }

  draft() {
    if (!this.drafts.has(this.robot)) this.drafts.set(this.robot, { waypoints: [], times: 1 });
    return this.drafts.get(this.robot);
  }

  // Whose mission it is; null: nobody's.
  select(robot) {
    this.robot = robot;
    this.show();
  }
  open() {
    this.isOpen = true;
    this.show();
  }
  close() {
    this.isOpen = false;
    this.show();
  }
  cancel() {
    this.drafts.delete(this.robot);
    this.close();
  }

  add([x, y, z]) {
    const { waypoints } = this.draft();
    if (waypoints.length >= MOST_WAYPOINTS) return;
    waypoints.push({ x: x, y: y, z: z, wait_s: 0 });
    this.show();
  }
  remove(waypoint) {
    this.draft().waypoints = this.draft().waypoints.filter((other) => other !== waypoint);
    this.show();
  }

  // The list stays, to be changed and sent again; open where it could not be sent.
  send() {
    const { waypoints, times } = this.draft();
    const places = waypoints.map(({ x, y, z, wait_s }) => ({ position: [x, y, z], wait_s: wait_s }));
    if (tell({ goal: { robot: this.robot, waypoints: places, times: times } })) this.close();
    else element("mission-hint").textContent = "Not sent: there is no connection.";
  }

  isShown() {
    return this.isOpen && this.robot !== null;
  }
  show() {
    if (this.isShown()) element("waypoints").replaceChildren(...this.draft().waypoints.map((one, i) => this.row(one, i)));
    this.showChange();
  }

  // All but the rows, which stay while values are typed: the mouse may be down on one.
  showChange() {
    element("mission").hidden = !this.isShown();
    element("mission-edit").classList.toggle("on", this.isOpen);
    this.clearDrawing();
    if (!this.isShown()) return;
    const { waypoints, times } = this.draft(), places = waypoints.length * times;
    element("mission-title").textContent = "Mission of robot " + this.robot;
    element("mission-hint").textContent = waypoints.length >= MOST_WAYPOINTS ? "These are all that can be sent at once."
      : places > MOST_PLACES ? places + " places; at most " + MOST_PLACES + "." : "Each click into the scene adds a waypoint.";
    element("times").value = times;
    element("mission-send").disabled = waypoints.length === 0 || places > MOST_PLACES;
    this.drawMission(waypoints, times > 1);
  }

  row(waypoint, index) {
    const row = document.createElement("tr"), remove = document.createElement("button");
    row.insertCell().textContent = index + 1;
    for (const { name, step, least, most } of WAYPOINT_FIELDS) {
      const input = document.createElement("input");
      Object.assign(input, { type: "number", name: name, step: step, min: least, max: most, value: waypoint[name] });
      input.onchange = () => {  // what is no number within the limits is put back
        const { valueAsNumber: value } = input;
        if (value >= least && value <= most) waypoint[name] = hundredths(value);
        input.value = waypoint[name];
        this.showChange();
      };
      row.insertCell().append(input);
    }
    remove.textContent = "×";
    remove.title = "remove this waypoint";
    remove.onclick = () => this.remove(waypoint);
    row.insertCell().append(remove);
    return row;
  }

  // Waypoints with their numbers, lines down to the ground, and the way; back to the first where it is flown again.
  drawMission(waypoints, again) {
    const color = robotColor(this.robot), places = waypoints.map(({ x, y, z }) => [x, y, z]);
    places.forEach((place, i) => {
      const mark = new THREE.Mesh(new THREE.OctahedronBufferGeometry(0.16), new THREE.MeshLambertMaterial({ color: color }));
      const name = label(String(i + 1), color);
      mark.position.set(...place);
      name.position.set(place[0], place[1], place[2] + 0.4);
      this.drawn.add(mark, name, this.lines([place, [place[0], place[1], 0]], color, 0.5));
    });
    if (places.length > 1) this.drawn.add(this.lines(again ? [...places, places[0]] : places, color, 1));
  }
  lines(places, color, opacity) {
    return new THREE.Line(new THREE.BufferGeometry().setFromPoints(places.map((place) => new THREE.Vector3(...place))),
      new THREE.LineBasicMaterial({ color: color, transparent: opacity < 1, opacity: opacity }));
  }
  clearDrawing() {
    for (const part of [...this.drawn.children]) {
      this.drawn.remove(part);
      discard(part);
    }
  }
}
