"use strict";
// Draws a scene and what changes from step to step. Everything stands in the page as it is; how many times errors are
// enlarged is chosen here: pose = exp(factor * rotation) * pose without error, shifted by factor * shift.
const content = JSON.parse(document.getElementById("content").textContent);
const $ = id => document.getElementById(id);
const pane = $("pane"), notice = $("notice");
const three = MeshCat.THREE;
let film = content.film, at = content.first, factor = content.exaggeration, viewer = null, speed = 0, software = false;

const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
const floats = text => new Float32Array(bytes(text).buffer);
const figure = value => value.toFixed(Math.abs(value) < 100 ? 2 : 0);
const rgb = colour => `rgb(${colour.map(value => Math.round(255 * value)).join(",")})`;
const matrix = new three.Matrix4(), spin = new three.Quaternion(), turn = new three.Quaternion(), one = new three.Vector3(1, 1, 1);

function element(tag, more, ...children) {
  const made = Object.assign(document.createElement(tag), more);
  made.append(...children);
  return made;
}

function by_software() {  // without a graphics card smooth edges cost more than they are worth
  const gl = document.createElement("canvas").getContext("webgl"), asked = gl && gl.getExtension("WEBGL_debug_renderer_info");
  return Boolean(asked) && /swiftshader|llvmpipe|software/i.test(gl.getParameter(asked.UNMASKED_RENDERER_WEBGL));
}

function start() {
  software = by_software();
  const renderer = new three.WebGLRenderer({ antialias: !software, preserveDrawingBuffer: true });  // else print is black
  pane.appendChild(renderer.domElement);
  viewer = new MeshCat.Viewer(pane, true, renderer);
  viewer.set_3d_pane_size = () => {
    const width = pane.clientWidth, height = pane.clientHeight;
    viewer.camera.aspect = width / height;
    viewer.camera.zoom = Math.min(1, width / height);  // a narrow pane shows as much from side to side
    viewer.camera.updateProjectionMatrix();
    renderer.setSize(width, height);
    viewer.set_dirty();
  };
  new ResizeObserver(() => viewer.set_3d_pane_size()).observe(pane);
  for (const path of ["Grid", "Axes"]) { viewer.set_property([path], "visible", false); }
  const dark = matchMedia("(prefers-color-scheme: dark)");
  dark.onchange = () => {
    content.sky.forEach((colour, k) => viewer.set_property(["Background"], ["top_color", "bottom_color"][k],
      dark.matches ? colour.map(value => 0.22 * value) : colour));
    viewer.show_background();
  };
  dark.onchange();
  root = viewer.scene_tree.find(["scene"]).object;
  robots = content.robots.map(build);
  arrows = film.arrows.map(arrow);
}

// --- what stands in the scene --------------------------------------------------------------------------------

let root = null, robots = [], arrows = [];
const shapes = content.shapes.map(shape => {
  const faces = bytes(shape.faces).buffer, normals = Float32Array.from(new Int8Array(bytes(shape.normals).buffer));
  return { position: floats(shape.vertices), normal: normals, edges: floats(shape.edges),
    faces: shape.wide ? new Uint32Array(faces) : new Uint16Array(faces) };
});

function merged(visuals) {  // one surface and one set of lines: a browser draws few large things faster than many small ones
  const parts = { position: [], normal: [], edges: [], faces: [] };
  for (const visual of visuals) {
    const shape = shapes[visual.shape], place = new three.Matrix4().fromArray(visual.matrix);
    const turned = new three.Matrix3().setFromMatrix4(place), first = parts.position.length / 3;
    for (const [name, by] of [["position", place], ["edges", place], ["normal", turned]]) {
      const array = new three.BufferAttribute(shape[name].slice(), 3);
      (name === "normal" ? array.applyMatrix3(by) : array.applyMatrix4(by)).array.forEach(value => parts[name].push(value));
    }
    shape.faces.forEach(number => parts.faces.push(first + number));
  }
  const surface = new three.BufferGeometry(), edges = new three.BufferGeometry();
  surface.setAttribute("position", new three.Float32BufferAttribute(parts.position, 3));
  surface.setAttribute("normal", new three.Float32BufferAttribute(parts.normal, 3));
  surface.setIndex(parts.faces);
  edges.setAttribute("position", new three.Float32BufferAttribute(parts.edges, 3));
  return [surface, edges];
}

function build(robot) {
  const ghost = robot.opacity < 1, groups = new Map(), parts = new Map(), whole = new three.Group();
  const varies = Boolean(film.robots[robot.name].colours);
  robot.visuals.forEach((visual, number) => {  // what moves as one and has one colour is one thing
    const key = `${visual.body} ${varies ? number : visual.colour}`;
    if (!parts.has(key)) { parts.set(key, { ...visual, number, visuals: [] }); }
    parts.get(key).visuals.push(visual);
  });
  for (const part of parts.values()) {
    if (!groups.has(part.body)) {
      const group = new three.Group();
      group.matrixAutoUpdate = false;
      groups.set(part.body, group);
      whole.add(group);
    }
    const [surface, edges] = merged(part.visuals), colour = new three.Color(...part.colour);
    // Behind what is solid where both stand in one place: a polygon's offset moves it away from the eye.
    part.mesh = new three.Mesh(surface, new three.MeshLambertMaterial({
      color: colour, opacity: robot.opacity, transparent: ghost, depthWrite: !ghost,
      polygonOffset: true, polygonOffsetFactor: ghost ? 3 : 1, polygonOffsetUnits: ghost ? 12 : 1 }));
    part.lines = new three.LineSegments(edges, new three.LineBasicMaterial({
      color: colour.clone().multiplyScalar(0.45), opacity: ghost ? 0.45 : 0.55, transparent: true }));
    groups.get(part.body).add(part.mesh, part.lines);
  }
  const links = new Map(robot.visuals.map(visual => [visual.name, visual.body]));
  root.add(whole);
  return { ...robot, ghost, groups, links, parts: [...parts.values()], whole, course: course(film.robots[robot.name]) };
}

function course(packed) {
  return { places: packed.places.map(floats), errors: packed.errors.map(floats),
    colours: packed.colours && packed.colours.map(bytes) };
}

function arrow(item) {
  const paint = new three.MeshLambertMaterial({ color: new three.Color(...item.colour), depthTest: false, transparent: true });
  const shaft = new three.CylinderGeometry(1, 1, 1, 8, 1, true).rotateX(Math.PI / 2).translate(0, 0, 0.5);
  const head = new three.ConeGeometry(1, 1, 12).rotateX(Math.PI / 2).translate(0, 0, 0.5);
  const parts = [shaft, head].map(shape => new three.InstancedMesh(shape, paint, item.count));
  parts.forEach(part => { part.renderOrder = 10; part.frustumCulled = false; root.add(part); });
  const label = element("span", { className: "label" });
  label.style.color = rgb(item.colour);
  if (item.count === 1) { pane.appendChild(label); }
  return { ...item, parts, label, ends: floats(item.ends), tail: new three.Vector3(), tip: new three.Vector3() };
}

// --- one moment ------------------------------------------------------------------------------------------------

function mixed(values, width, k) {  // between two steps, for smooth playing; at a step, exactly that step
  const last = values.length / width - 1, low = Math.min(Math.floor(k), last), share = Math.min(k, last) - low;
  const first = values.subarray(width * low, width * low + width);
  if (share === 0) { return first; }
  const next = values.subarray(width * low + width, width * low + 2 * width);
  const sign = width === 7 && first[3] * next[3] + first[4] * next[4] + first[5] * next[5] + first[6] * next[6] < 0 ? -1 : 1;
  return first.map((value, n) => (1 - share) * value + share * (n > 2 ? sign : 1) * next[n]);
}

function pose(places, errors, k) {  // writes the pose of one body into `matrix`
  const p = mixed(places, 7, k), e = mixed(errors, 6, k);
  const angle = factor * Math.hypot(e[3], e[4], e[5]), half = angle ? Math.sin(angle / 2) * factor / angle : factor / 2;
  spin.set(p[3], p[4], p[5], p[6]).normalize();
  turn.set(half * e[3], half * e[4], half * e[5], Math.cos(angle / 2));
  return matrix.compose(new three.Vector3(p[0] + factor * e[0], p[1] + factor * e[1], p[2] + factor * e[2]), turn.multiply(spin), one);
}

function show() {
  if (viewer) {
    for (const robot of robots) {
      robot.whole.visible = seen(robot.name);
      for (const [body, group] of robot.groups) {
        group.matrix.copy(pose(robot.course.places[body], robot.course.errors[body], at));
        group.matrixWorldNeedsUpdate = true;
      }
      if (robot.course.colours) { paint(robot, robot.course.colours); }
    }
    hide_twins();
    arrows.forEach(place_arrows);
    viewer.set_dirty();
  }
  tell();
}

function paint(robot, colours) {
  const now = colours[Math.min(Math.round(at), colours.length - 1)];
  for (const { mesh, number } of robot.parts) {
    mesh.material.color.setRGB(...Array.from(now.subarray(3 * number, 3 * number + 3), value => value / 255));
  }
}

function hide_twins() {  // what a translucent robot has exactly where a solid one has it too: no gap looks like no gap
  const solid = robots.filter(robot => !robot.ghost && robot.whole.visible);
  for (const robot of robots.filter(one => one.ghost)) {
    robot.groups.forEach(group => { group.visible = true; });
    for (const other of solid) {
      robot.links.forEach((body, name) => {
        const twin = other.groups.get(other.links.get(name)), own = robot.groups.get(body);
        if (twin && own.matrix.elements.every((value, n) => Math.abs(value - twin.matrix.elements[n]) < 3e-4)) { own.visible = false; }
      });
    }
  }
}

function place_arrows(item) {
  const width = 6 * item.count, ends = mixed(item.ends, width, at);
  const thick = content.thickness * (item.count > 1 ? 0.5 : 1), up = new three.Vector3(0, 0, 1);
  for (let n = 0; n < item.count; n += 1) {
    const e = ends.subarray(6 * n, 6 * n + 6), tail = new three.Vector3(e[0], e[1], e[2]);
    const arm = new three.Vector3(e[3], e[4], e[5]).multiplyScalar(factor), length = arm.length();
    const head = Math.min(7 * thick, 0.75 * length), round = Math.min(thick, head / 7);
    spin.setFromUnitVectors(up, length ? arm.clone().divideScalar(length) : up);
    item.parts[0].setMatrixAt(n, matrix.compose(tail, spin, new three.Vector3(round, round, length - head)));
    item.tip.copy(tail).add(arm);
    const neck = tail.clone().lerp(item.tip, length ? 1 - head / length : 1);
    // An arrow of no length is a dot.
    const [broad, long] = length > thick / 2 ? [head / 2.6, head] : [thick, thick];
    item.parts[1].setMatrixAt(n, matrix.compose(neck, spin, new three.Vector3(broad, broad, long)));
    item.tail.copy(tail);
  }
  // A figure is that of the step that is told: the mean of two arrows may be shorter than both.
  const [x, y, z] = mixed(item.ends, width, Math.round(at)).subarray(3);
  item.label.textContent = `${(1000 * Math.hypot(x, y, z)).toFixed(2)} mm`;
  item.parts.forEach(part => {
    part.instanceMatrix.needsUpdate = true;
    part.visible = item.shown_with ? seen(item.shown_with) : seen(item.name);
  });
}

const axes = [...document.querySelectorAll("#axes path")].map(line => [line, line.nextElementSibling]);

function place_words() {  // labels stay beside their arrows, and axes point where they do, wherever the camera goes
  requestAnimationFrame(place_words);
  axes.forEach(([line, name], k) => {
    const { x, y } = new three.Vector3().setComponent(k, 1).transformDirection(root.matrixWorld)
      .transformDirection(viewer.camera.matrixWorldInverse);
    const course = `M0 0L${10 * x} ${-10 * y}`;
    if (line.getAttribute("d") === course) { return; }  // as long as the camera stands nothing is painted anew
    line.setAttribute("d", course);
    name.setAttribute("x", 13 * x);
    name.setAttribute("y", -13 * y);
  });
  for (const item of arrows) {
    if (item.count > 1) { continue; }
    const [tail, tip] = [item.tail, item.tip].map(end => end.clone().applyMatrix4(root.matrixWorld).project(viewer.camera));
    item.label.hidden = !item.parts[0].visible || tip.z > 1;
    // In parts of the pane: on paper it is of another size.
    item.label.style.left = `clamp(0px, ${50 + 50 * Math.max(tail.x, tip.x)}% + 18px, 100% - ${item.label.offsetWidth + 4}px)`;
    item.label.style.top = `${50 - 50 * tip.y}%`;
  }
}

// --- words and controls ------------------------------------------------------------------------------------------

const boxes = [...document.querySelectorAll("#legend input")];
const seen = name => { const box = boxes.find(one => one.value === name); return !box || box.checked; };
const states = boxes.filter(box => box.type === "radio");
boxes.forEach(box => { box.checked = box.type === "checkbox" || box === states[0]; });
$("legend").addEventListener("change", show);

let told = null, told_at = 0;
function tell() {  // words are painted by the page, which takes longer than the robot: while it plays, some times a second
  const k = Math.round(at), step = film.steps[k];
  if ($("cursor")) { $("cursor").style.left = `${100 * (place() - film.at[0]) / span}%`; }  // right at every size of the plot
  if (speed && performance.now() - told_at < 200) { return; }
  told_at = performance.now();
  $("scale").textContent = Math.abs(factor - 1) < 0.005 ? "drawn to scale" : `errors drawn ${+factor.toPrecision(3)} × their size`;
  if ($("time")) {
    $("time").value = at;
    $("step").textContent = step.label;
  }
  document.querySelectorAll("#keys output").forEach((cell, n) => {
    const value = film.curves[n].values[k];
    cell.textContent = value === null ? "–" : `${figure(value)} ${film.curves[n].unit}`;
  });
  document.querySelectorAll("#steps button").forEach((button, n) => button.setAttribute("aria-pressed", n === k));
  if (told === step) { return; }
  told = step;
  $("caption").replaceChildren(...step.caption.map(([what, figure]) =>
    element("tr", {}, element("th", { textContent: what }), element("td", { textContent: figure }))));
}

const span = film.at[film.at.length - 1] - film.at[0] || 1;
function draw_curves() {
  const box = $("curves");
  if (!box) { return; }
  for (const curve of film.curves) {
    const own = Math.max(...film.curves.filter(one => one.unit === curve.unit).flatMap(one => one.values), 1e-12);
    const points = curve.values.map((value, k) => value === null ? "" : `${1000 * (film.at[k] - film.at[0]) / span},${96 - 92 * value / own}`);
    const line = box.appendChild(document.createElementNS(box.namespaceURI, "polyline"));
    line.setAttribute("points", points.join(" "));
    line.setAttribute("stroke", rgb(curve.colour));
  }
  document.querySelectorAll("#keys small").forEach((cell, n) => {
    const { values, unit } = film.curves[n], [least, most] = [Math.min, Math.max].map(pick => pick(...values.filter(value => value !== null)));
    cell.textContent = `(${figure(least)} to ${figure(most)} ${unit})`;
  });
  const seek = event => {
    if (event.type === "pointermove" && !event.buttons) { return; }
    const edge = box.getBoundingClientRect();
    go(Math.round(step_at(film.at[0] + span * Math.min(Math.max((event.clientX - edge.left) / edge.width, 0), 1))));
  };
  box.addEventListener("pointerdown", seek);
  box.addEventListener("pointermove", seek);
}

function place() {  // on the axis, of the moment that is shown
  const low = Math.min(Math.floor(at), film.at.length - 2);
  return film.at[low] + (at - low) * (film.at[low + 1] - film.at[low]);
}

function step_at(place) {  // the step, with its fraction, of a place on the axis
  const next = film.at.findIndex(value => value > place);
  if (next < 0) { return film.at.length - 1; }
  return next === 0 ? 0 : next - 1 + (place - film.at[next - 1]) / (film.at[next] - film.at[next - 1]);
}

function go(k) { at = k; show(); }

let before = 0, slow = 0;
function sharpness(ratio, edged = true) {  // a coarser picture while it moves, where the browser cannot keep up
  if (viewer && viewer.renderer.getPixelRatio() !== ratio) { viewer.renderer.setPixelRatio(ratio); }
  robots.forEach(robot => robot.parts.forEach(part => { part.lines.visible = edged; }));
}

function play(now) {
  if (!speed) { sharpness(window.devicePixelRatio); go(Math.round(at)); return; }  // between two steps there is nothing
  slow = 0.8 * slow + 0.2 * (now - before);
  if (viewer && slow > 1000 / 30) {
    sharpness(Math.max(0.5, 0.8 * viewer.renderer.getPixelRatio()));
    if (software) { notice.textContent = `${Math.round(1000 / slow)} pictures a second: this browser draws without a graphics card`; }
  }
  const next = place() + speed * Math.min(now - before, 200) / 1000;
  before = now;
  go(next > film.at[film.at.length - 1] ? 0 : step_at(next));
  requestAnimationFrame(play);
}

if ($("time")) {
  $("time").addEventListener("input", event => go(Number(event.target.value)));
  $("play").addEventListener("click", () => {
    speed = speed ? 0 : span / Math.min(Math.max(film.at.length / 10, 8), 30);  // the whole takes 8 to 30 s
    $("play").textContent = speed ? "pause" : "play";
    before = performance.now();
    slow = 0;
    requestAnimationFrame(play);
  });
  draw_curves();
}
document.querySelectorAll("#steps button").forEach(button => button.addEventListener("click", () => go(Number(button.dataset.step))));

const most = Math.max(200, content.exaggeration), stretch = $("factor");
stretch.value = Math.log(Math.max(factor, 1)) / Math.log(most);
stretch.addEventListener("input", () => { factor = most ** Number(stretch.value); show(); });

function look(name) {
  const { eye, target, view_deg } = content.cameras[name];
  const [x, y, z] = eye.map((value, k) => value - target[k]), distance = Math.hypot(x, y, z);
  // meshcat's camera turns about the origin, so the scene is moved until the camera's target lies there.
  root.matrixAutoUpdate = false;
  root.matrix.makeTranslation(-target[0], -target[1], -target[2]);
  root.matrixWorldNeedsUpdate = true;
  viewer.camera.fov = view_deg;
  viewer.camera.near = distance / 50;
  viewer.camera.position.set(x, z, -y);  // the folder "rotated" turns three.js's y axis into the world's z axis
  viewer.controls.target.set(0, 0, 0);
  light(x, y, z, distance);
  viewer.set_3d_pane_size();
}

function light(x, y, z, distance) {
  const forward = new three.Vector3(-x, -y, -z).normalize(), right = new three.Vector3(0, 0, 1).cross(forward).negate().normalize();
  const up = right.clone().cross(forward);
  const lamp = (name, a, b, c, intensity) => {
    const place = right.clone().multiplyScalar(a).addScaledVector(up, b).addScaledVector(forward, c).multiplyScalar(distance);
    const path = ["Lights", name, "<object>"];
    viewer.set_property(path, "position", place.toArray());
    viewer.set_property(path, "distance", 0);
    viewer.set_property(path, "intensity", intensity);
  };
  lamp("PointLightNegativeX", 0.5, 0.8, -0.7, 0.55);
  lamp("PointLightPositiveX", -0.9, 0.2, -0.5, 0.25);
  viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.5);
  viewer.set_property(["Lights", "FillLight", "<object>"], "intensity", 0.1);
}

try {
  start();
  for (const name of Object.keys(content.cameras)) {
    $("views").append(element("button", { type: "button", textContent: name, onclick: () => look(name) }));
  }
  look("all");
  show();
  place_words();
} catch (error) {
  viewer = null;
  notice.textContent = "This page draws with WebGL, which this browser does not offer: " + error.message;
  tell();
}

const socket = content.live ? new WebSocket("ws://" + location.host + "/bench") : null;
if (socket) { socket.onclose = () => { notice.textContent = "The program that showed this scene has ended."; }; }
