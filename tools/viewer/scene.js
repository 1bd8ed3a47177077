// What is drawn: robots, trajectories, goals, obstacles, voxels and corridors in W (metres, z up), with three.js.
"use strict";

// Told apart also by those who see red and green alike; further robots begin again.
const ROBOT_COLORS = ["#d1495b", "#00798c", "#8b5fbf", "#c77d0a", "#3d5a80", "#5c8001", "#7c3626", "#b5179e"];
const robotColor = (id) => ROBOT_COLORS[id % ROBOT_COLORS.length];

// Gives back what a part that is no longer drawn had of the graphics processor.
function discard(part) {
  if (!part.isSprite) part.geometry.dispose();  // all sprites share one
  if (part.material.map) part.material.map.dispose();
  part.material.dispose();
}

// Cubes that the graphics processor places itself: per cube four numbers, whose meaning `place` (GLSL) knows.
class Cubes {
  constructor(Numbers, place, uniforms, opacity) {
    this.Numbers = Numbers;
    this.material = new THREE.ShaderMaterial({
      uniforms: uniforms,
      transparent: opacity < 1,
      vertexShader: `
        attribute vec4 cube;
        varying vec3 color;
        ${place}
        void main() {
          vec4 placed = place(cube);  // middle and edge; sets color
          float light = 0.72 + 0.28 * dot(normal, vec3(0.2, 0.45, 0.87));
          color *= light;
          gl_Position = projectionMatrix * modelViewMatrix * vec4(placed.xyz + position * placed.w, 1.0);
        }`,
      fragmentShader: `varying vec3 color; void main() { gl_FragColor = vec4(color, ${opacity.toFixed(2)}); }`,
    });
    this.mesh = new THREE.Mesh(new THREE.BufferGeometry(), this.material);
    this.mesh.frustumCulled = false;
    this.count = 0;
    this.reserve(1024);
  }

  // Buffers of the graphics processor grow, but are never given up one by one.
  reserve(count) {
    const box = new THREE.BoxBufferGeometry(1, 1, 1);
    const geometry = new THREE.InstancedBufferGeometry();
    geometry.index = box.index;
    geometry.setAttribute("position", box.attributes.position);
    geometry.setAttribute("normal", box.attributes.normal);
    const attribute = new THREE.InstancedBufferAttribute(new this.Numbers(4 * count), 4, false);
    attribute.setUsage(THREE.DynamicDrawUsage);
    geometry.setAttribute("cube", attribute);
    this.mesh.geometry.dispose();
    this.mesh.geometry = geometry;
    this.capacity = count;
  }

  set(numbers) {
    this.count = numbers.length / 4;
    if (this.count > this.capacity) this.reserve(2 * this.count);
    const attribute = this.mesh.geometry.attributes.cube;
    attribute.array.set(numbers);
    attribute.updateRange = { offset: 0, count: Math.max(numbers.length, 4) };
    attribute.needsUpdate = true;
    this.mesh.geometry.maxInstancedCount = this.count;
    this.mesh.visible = this.count > 0;
  }
}

class SwarmScene {
  constructor() {
    this.renderer = new THREE.WebGLRenderer({ antialias: true });
    this.renderer.setPixelRatio(window.devicePixelRatio);
    document.body.prepend(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color("#eef1f3");
    this.camera = new THREE.PerspectiveCamera(45, 1, 0.1, 500);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(0, -17, 15);
    this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.target.set(0, 0, 0.5);
    this.scene.add(new THREE.HemisphereLight("#ffffff", "#9aa4ad", 0.95));
    const sun = new THREE.DirectionalLight("#ffffff", 0.35);
    sun.position.set(3, -4, 10);
    this.scene.add(sun);
    const grid = new THREE.GridHelper(40, 40, "#9aa4ad", "#d5dbe0");
    grid.rotation.x = Math.PI / 2;
    this.scene.add(grid);
    this.scene.add(new THREE.AxesHelper(1));

    // Of a map: voxel in the window and the first frame that it is occupied in, green (now) to blue (its end).
    this.voxels = new Cubes(Int16Array, `
      uniform vec3 origin;
      uniform float resolution, frames;
      vec4 place(vec4 cube) {
        color = mix(vec3(0.12, 0.66, 0.29), vec3(0.12, 0.31, 0.85), clamp(cube.w / max(frames - 1.0, 1.0), 0.0, 1.0));
        return vec4((origin + cube.xyz + 0.5) * resolution, resolution * 0.92);
      }`,
      { origin: { value: new THREE.Vector3() }, resolution: { value: 0.1 }, frames: { value: 20 } }, 0.55);
    this.scene.add(this.voxels.mesh);
    this.walls = new Cubes(Float32Array,
      `vec4 place(vec4 cube) { color = vec3(0.62, 0.66, 0.7); return cube; }`, {}, 1.0);
    this.scene.add(this.walls.mesh);

    // What a robot's sensors saw: where rays ended, those on robots in violet; and what it holds to stand.
    this.scan = new Cubes(Float32Array,
      `vec4 place(vec4 cube) { color = mix(vec3(0.85, 0.33, 0.1), vec3(0.55, 0.37, 0.75), cube.w); return vec4(cube.xyz, 0.05); }`,
      {}, 1.0);
    this.standing = new Cubes(Int16Array, `
      uniform vec3 origin;
      uniform float resolution;
      vec4 place(vec4 cube) {
        color = vec3(0.45, 0.4, 0.36);
        return vec4((origin + cube.xyz + 0.5) * resolution, resolution * 0.96);
      }`,
      { origin: { value: new THREE.Vector3() }, resolution: { value: 0.1 } }, 0.35);
    this.masks = new THREE.Group();
    this.sight = new THREE.Group();
    this.sight.add(this.scan.mesh, this.standing.mesh, this.masks);
    this.scene.add(this.sight);

    this.faces = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial(
      { color: "#c77d0a", transparent: true, opacity: 0.07, side: THREE.DoubleSide, depthWrite: false }));
    this.edges = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial(
      { color: "#c77d0a", transparent: true, opacity: 0.6 }));
    this.corridors = new THREE.Group();
    this.corridors.add(this.faces, this.edges);
    this.scene.add(this.corridors);

    this.obstacleGroup = new THREE.Group();
    this.scene.add(this.obstacleGroup);
    this.obstacles = new Map();
    this.robots = new Map();
    this.names = [];  // as they were placed last: {id, box}, see spreadLabels
    window.addEventListener("resize", () => this.resize());
    this.resize();
  }

  resize() {
    this.renderer.setSize(window.innerWidth, window.innerHeight);
    this.camera.aspect = window.innerWidth / window.innerHeight;
    this.camera.updateProjectionMatrix();
    for (const robot of this.robots.values()) {
      for (const line of Object.values(robot.lines)) line.material.resolution.set(window.innerWidth, window.innerHeight);
    }
  }

  line(color, width, opacity) {
    const material = new THREE.LineMaterial({ color: color, linewidth: width, transparent: opacity < 1, opacity: opacity });
    material.resolution.set(window.innerWidth, window.innerHeight);
    const line = new THREE.Line2(new THREE.LineGeometry(), material);
    line.frustumCulled = false;
    line.visible = false;
    this.scene.add(line);
    return line;
  }

  addRobot(id) {
    const color = robotColor(id);
    const body = new THREE.Mesh(new THREE.SphereBufferGeometry(1, 24, 16), new THREE.MeshLambertMaterial({ color: color }));
    const goal = new THREE.Mesh(new THREE.OctahedronBufferGeometry(0.14), new THREE.MeshLambertMaterial(
      { color: color, transparent: true, opacity: 0.7 }));
    const name = label(String(id), color);
    this.scene.add(body, goal, name);
    const robot = {
      body: body, goal: goal, name: name, drawn: {},
      lines: { committed: this.line(color, 4, 1), next: this.line(color, 4, 0.6), pending: this.line(color, 2, 0.35) },
    };
    this.robots.set(id, robot);
    return robot;
  }

  removeRobot(id) {
    const robot = this.robots.get(id);
    for (const part of [robot.body, robot.goal, robot.name, ...Object.values(robot.lines)]) {
      this.scene.remove(part);
      discard(part);
    }
    this.robots.delete(id);
  }

  // A trajectory is known by its number, and its start for robots that count anew.
  setLine(robot, which, trajectory, numbers) {
    const line = robot.lines[which];
    line.visible = Boolean(trajectory) && trajectory.points.count >= 6;
    const key = line.visible && trajectory.seq + "@" + trajectory.start_utime;
    if (!line.visible || robot.drawn[which] === key) return;
    robot.drawn[which] = key;
    line.geometry.dispose();
    line.geometry = new THREE.LineGeometry();
    line.geometry.setPositions(numbers(trajectory.points));
  }

  setRobots(robots, numbers) {
    for (const id of [...this.robots.keys()]) if (!robots.some((r) => r.id === id)) this.removeRobot(id);
    for (const told of robots) {
      const robot = this.robots.get(told.id) || this.addRobot(told.id);
      const place = told.position;
      robot.body.visible = Boolean(place);
      if (place) {
        robot.body.position.set(...place);
        robot.body.scale.setScalar(told.radius || 0.2);
        robot.name.position.set(place[0], place[1], place[2] + (told.radius || 0.2) + 0.35);
      }
      robot.goal.visible = Boolean(told.goal);
      if (told.goal) robot.goal.position.set(...told.goal);
      for (const which of ["committed", "next", "pending"]) this.setLine(robot, which, told[which], numbers);
    }
  }

  // The shape of an obstacle, larger by `grown` (m) to every side.
  static shape(obstacle, grown) {
    const [a, b, c] = obstacle.shape === "ring" ? [obstacle.size[0], obstacle.size[1] + 2 * grown, 0]
      : obstacle.size.map((size) => size + 2 * grown);
    if (obstacle.shape === "ring") {
      const ring = new THREE.TorusBufferGeometry(a, b / 2, 12, 48);
      ring.rotateY(Math.PI / 2);  // its axis along x
      return ring;
    }
    if (obstacle.shape === "box") return new THREE.BoxBufferGeometry(a, b, c);
    if (obstacle.shape === "sphere") return new THREE.SphereBufferGeometry(a / 2, 24, 16);
    const column = new THREE.CylinderBufferGeometry(a / 2, a / 2, b, 24);
    column.rotateX(Math.PI / 2);  // upright
    return column;
  }

  setObstacles(obstacles) {
    const told = new Set();
    for (const obstacle of obstacles) {
      told.add(obstacle.id);
      const uncertain = 2 * Math.round(100 * (obstacle.sigma || 0)) / 100;  // two standard deviations
      const form = obstacle.shape + obstacle.size + "+" + uncertain;
      let drawn = this.obstacles.get(obstacle.id);
      if (drawn && drawn.form !== form) {
        this.removeObstacle(obstacle.id);
        drawn = undefined;
      }
      if (!drawn) {
        const mesh = new THREE.Mesh(SwarmScene.shape(obstacle, 0), new THREE.MeshLambertMaterial(
          { color: "#8a949c", transparent: true, opacity: 0.55 }));
        const shell = new THREE.Mesh(SwarmScene.shape(obstacle, uncertain), new THREE.MeshBasicMaterial(
          { color: "#8a949c", transparent: true, opacity: 0.18, depthWrite: false }));
        shell.visible = uncertain > 0;
        mesh.add(shell);
        const arrow = new THREE.ArrowHelper(new THREE.Vector3(1, 0, 0), new THREE.Vector3(), 1, "#4a545c", 0.25, 0.15);
        this.obstacleGroup.add(mesh, arrow);
        drawn = { form: form, mesh: mesh, shell: shell, arrow: arrow };
        this.obstacles.set(obstacle.id, drawn);
      }
      drawn.mesh.position.set(...obstacle.position);
      drawn.mesh.rotation.z = obstacle.yaw;
      const velocity = new THREE.Vector3(...obstacle.velocity), speed = velocity.length();
      drawn.arrow.visible = speed > 0.05;
      if (drawn.arrow.visible) {
        drawn.arrow.position.copy(drawn.mesh.position);
        drawn.arrow.setDirection(velocity.normalize());
        drawn.arrow.setLength(0.5 + speed, 0.25, 0.15);
      }
    }
    for (const id of [...this.obstacles.keys()]) if (!told.has(id)) this.removeObstacle(id);
  }

  removeObstacle(id) {
    const { mesh, shell, arrow } = this.obstacles.get(id);
    this.obstacleGroup.remove(mesh, arrow);
    for (const part of [mesh, shell]) discard(part);
    arrow.line.material.dispose();
    arrow.cone.material.dispose();
    this.obstacles.delete(id);
  }

  setSogm(sogm, numbers) {
    const uniforms = this.voxels.material.uniforms;
    uniforms.origin.value.set(...sogm.origin);
    uniforms.resolution.value = sogm.resolution;
    uniforms.frames.value = sogm.num_frames;
    this.voxels.set(numbers(sogm.voxels, Int16Array));
  }

  setSeenSpace(grid, numbers) {
    const uniforms = this.standing.material.uniforms;
    uniforms.origin.value.set(...grid.origin);
    uniforms.resolution.value = grid.resolution;
    this.standing.set(numbers(grid.voxels, Int16Array));
  }

  setScans(scans, numbers) {
    this.scan.set(numbers(scans.points));
    while (this.masks.children.length < scans.masks.length) {
      this.masks.add(new THREE.Mesh(new THREE.SphereBufferGeometry(1, 16, 12), new THREE.MeshBasicMaterial(
        { color: "#8b5fbf", transparent: true, opacity: 0.12, depthWrite: false })));
    }
    this.masks.children.forEach((ball, i) => {
      ball.visible = i < scans.masks.length;
      if (!ball.visible) return;
      ball.position.set(...scans.masks[i].position);
      ball.scale.setScalar(scans.masks[i].radius);
    });
  }

  setCorridors(corridors, numbers) {
    for (const [mesh, place] of [[this.faces, corridors.triangles], [this.edges, corridors.edges]]) {
      mesh.geometry.dispose();
      mesh.geometry = new THREE.BufferGeometry();
      mesh.geometry.setAttribute("position", new THREE.BufferAttribute(numbers(place).slice(), 3));
      mesh.frustumCulled = false;
    }
  }

  forgetSelected() {
    for (const cubes of [this.voxels, this.standing, this.scan])
      if (cubes.count > 0) cubes.set(new cubes.Numbers(0));
    this.corridors.visible = this.masks.visible = false;
  }

  // So that all these places are seen, from the south and from above.
  aim(places) {
    if (places.length === 0) return;
    const box = new THREE.Box3().setFromPoints(places.map((place) => new THREE.Vector3(...place)));
    const size = Math.max(4, box.getSize(new THREE.Vector3()).length());
    box.getCenter(this.controls.target);
    this.camera.position.copy(this.controls.target).add(new THREE.Vector3(0, -0.8 * size, 0.7 * size));
  }

  // Where the ray through a pixel meets a height; null: nowhere.
  pointAt(x, y, height) {
    const caster = new THREE.Raycaster();
    caster.setFromCamera(new THREE.Vector2(2 * x / window.innerWidth - 1, 1 - 2 * y / window.innerHeight), this.camera);
    return caster.ray.intersectPlane(new THREE.Plane(new THREE.Vector3(0, 0, 1), -height), new THREE.Vector3());
  }

  follow(position) {
    const target = new THREE.Vector3(...position), step = target.clone().sub(this.controls.target);
    this.camera.position.add(step);
    this.controls.target.copy(target);
  }

  // The names of robots that are seen, none of them over another.
  placeNames() {
    this.camera.updateMatrixWorld();
    const named = [...this.robots].filter(([, robot]) => robot.body.visible);
    for (const robot of this.robots.values()) robot.name.visible = false;
    const boxes = spreadLabels(named.map(([, robot]) => robot.name), this.camera, window.innerWidth, window.innerHeight);
    this.names = named.map(([id], i) => ({ id: id, box: boxes[i] }));
  }

  draw() {
    this.controls.update();
    this.placeNames();
    this.renderer.render(this.scene, this.camera);
  }
}
