// What keys and mouse do, and the overlay that says so.
"use strict";

const canGiveOrders = () => Boolean(frame && frame.allow_goals);

const KEYS = [
  { key: "f", text: "look at the robot that was chosen; at all while none is", press: () => lookAtChosen() },
  { key: "a", text: "look at all robots and their goals", press: () => lookAtAll() },
  { key: "p", text: "show plots, or hide them", press: () => element("show-plots").click() },
  { key: " ", name: "space", text: "play a log, or pause", press: () => { if (frame && frame.mode === "log") element("play").click(); } },
  { key: "m", text: "plan a mission, where goals are allowed", press: () => { if (canGiveOrders()) element("mission-edit").click(); } },
  { key: "?", text: "show this, or hide it", press: () => showHelp(element("help").hidden) },
  { key: "Escape", name: "Esc", text: "close this, or the mission that is planned", press: () => element("help").hidden ? mission.close() : showHelp(false) },
];

const MOUSE = [
  ["drag", "turn the view"],
  ["right drag", "move the view; also with Shift or Ctrl"],
  ["wheel", "come nearer, go further away"],
  ["click on a robot's box", "choose it: its SOGM, corridors and orders"],
  ["double click into the scene", "the chosen robot's goal, at the height on the left, where goals are allowed"],
  ["click, while a mission is planned", "one waypoint more"],
];

function showHelp(shown) {
  element("help").hidden = !shown;
}

for (const [what, text] of [...MOUSE, ...KEYS.map((key) => [key.name || key.key, key.text])]) {
  const row = element("help-rows").insertRow();
  row.insertCell().textContent = what;
  row.insertCell().textContent = text;
}
element("help-open").onclick = () => showHelp(true);
element("help-close").onclick = () => showHelp(false);

// Not while somebody types, or has a key press what is in focus.
window.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const types = event.key !== "Escape" && event.target.matches("input[type=number], select");
  const presses = event.key === " " && event.target.matches("input, button");
  const found = KEYS.find((key) => key.key === event.key);
  if (!found || types || presses) return;
  event.preventDefault();
  found.press();
});
