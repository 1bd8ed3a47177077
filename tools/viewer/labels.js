// Names of robots and numbers of waypoints, and how those of robots are kept apart on the screen.
"use strict";

const LABEL_EDGE_M = 0.7, LABEL_PIXELS = 64, LABEL_FONT = 44;
const LABEL_ROWS = 4;  // that a name may be moved up by, before it is hidden

function label(text, color) {
  const canvas = document.createElement("canvas"), middle = LABEL_PIXELS / 2;
  canvas.width = canvas.height = LABEL_PIXELS;
  const context = canvas.getContext("2d");
  context.font = "bold " + LABEL_FONT + "px sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineWidth = 8;
  context.strokeStyle = "white";
  context.strokeText(text, middle, middle + 2, LABEL_PIXELS - 8);
  context.fillStyle = color;
  context.fillText(text, middle, middle + 2, LABEL_PIXELS - 8);
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map: new THREE.CanvasTexture(canvas), depthTest: false }));
  sprite.scale.set(LABEL_EDGE_M, LABEL_EDGE_M, 1);
  sprite.userData.width = Math.min(1, (context.measureText(text).width + 4) / LABEL_PIXELS);  // of its edge
  sprite.userData.height = LABEL_FONT / LABEL_PIXELS;
  return sprite;
}

// Where one name would cover another, the later one is moved up by its height, and hidden where there is no room either.
// Returns the rectangles that the names take, in pixels; null: hidden.
function spreadLabels(labels, camera, width, height) {
  const taken = [];
  return labels.map((sprite) => {
    const seen = sprite.position.clone().applyMatrix4(camera.matrixWorldInverse);
    const edge = LABEL_EDGE_M * height / (2 * Math.tan(THREE.Math.degToRad(camera.fov / 2)) * -seen.z);
    const at = seen.clone().applyMatrix4(camera.projectionMatrix);
    const box = { width: edge * sprite.userData.width, height: edge * sprite.userData.height };
    box.x = width * (1 + at.x) / 2 - box.width / 2;
    const lowest = height * (1 - at.y) / 2 - box.height / 2;
    const covers = (other) => Math.abs(box.x + box.width / 2 - other.x - other.width / 2) < (box.width + other.width) / 2 &&
      Math.abs(box.y + box.height / 2 - other.y - other.height / 2) < (box.height + other.height) / 2;
    sprite.visible = false;
    for (let row = 0; row < LABEL_ROWS && seen.z < 0 && !sprite.visible; ++row) {
      box.y = lowest - 1.01 * row * box.height;
      sprite.center.y = 0.5 - 1.01 * row * sprite.userData.height;
      sprite.visible = !taken.some(covers);
    }
    if (sprite.visible) taken.push(box);
    return sprite.visible ? box : null;
  });
}
