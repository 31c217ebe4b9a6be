"use strict";
// Sliders that ask the program which shows the page for the robot. It remembers nothing: a question holds every value.
const bench = content.bench, inputs = new Map(), errors = { ...bench.errors.values };
let wish = null, asked = 0, moving = false, commanded = bench.groups[0].name;

function slider(own, chosen) {
  const limits = { min: own.lower, max: own.upper, step: "any", value: own.value };
  const range = element("input", { type: "range", ...limits }), number = element("input", { type: "number", ...limits });
  const label = element("label", { textContent: `${own.label}, ${own.unit}` });
  range.setAttribute("aria-label", label.textContent);
  number.setAttribute("aria-label", label.textContent);
  let held = own.value;  // a place beyond the slider's ends is kept as it is
  const set = value => { held = value; range.value = value; number.value = +value.toFixed(3); };
  for (const input of [range, number]) {
    input.addEventListener("input", () => {
      if (input.value === "") { return; }  // before the first digit: no zero
      held = Number(input.value);
      (input === range ? number : range).value = input === range ? +held.toFixed(3) : held;
      chosen(held, false);
    });
    input.addEventListener("change", () => {
      if (input.value === "") { set(held); }
      chosen(held, true);
    });
  }
  set(own.value);
  return { line: element("div", { className: "slider" }, label, number, range), set, value: () => held };
}

function ask(moved, settled) {
  if (bench.groups.find(group => group.name === moved)?.commands) { commanded = moved; }
  const values = Object.fromEntries([...inputs].map(([id, input]) => [id, input.value()]));
  wish = { commanded, settled, values, errors };
  moving = !settled;
  send();
}

function send() {  // the newest wish, once the last is answered
  if (!wish || asked || socket.readyState !== WebSocket.OPEN) { return; }
  asked = performance.now();
  socket.send(JSON.stringify(wish));
  wish = null;
}

socket.onopen = send;
socket.onmessage = message => {
  const answer = JSON.parse(message.data), took = Math.round(performance.now() - asked);
  asked = 0;
  notice.textContent = answer.refused || answer.notice || `answered in ${took} ms`;
  $("caption").dataset.of = answer.refused ? "of the last command that was not refused" : "";
  if (!answer.refused) {
    for (const [id, value] of Object.entries(answer.values)) {
      if (inputs.get(id).group !== commanded) { inputs.get(id).set(value); }  // the hand on a slider keeps it
    }
    film = { ...film, ...answer.film };
    robots.forEach(robot => { robot.course = course(film.robots[robot.name]); });
    arrows.forEach((item, n) => { item.ends = floats(film.arrows[n].ends); });
    if (software) { sharpness((moving ? 0.3 : 1) * window.devicePixelRatio, !moving); }  // while a hand is on a slider
    show();
  }
  send();
};

for (const group of bench.groups) {
  $("bench").append(element("h2", { textContent: group.name }));
  for (const own of group.sliders) {
    const made = slider(own, (value, settled) => ask(group.name, settled));
    inputs.set(own.id, { ...made, group: group.name });
    $("bench").append(made.line);
  }
}

const names = element("select", {}, ...Object.entries(bench.errors.names).map(([set, list]) =>
  element("optgroup", { label: set }, ...list.map(name => element("option", { textContent: name })))));
names.setAttribute("aria-label", "geometric error");
const unit = name => bench.errors.units[name], set_errors = element("div", { id: "set" });
let size = null;
function choose() {  // the slider of one error
  const name = names.value, most = bench.errors.largest[unit(name)];
  const made = slider({ label: name, unit: unit(name), lower: -most, upper: most, value: errors[name] || 0 }, (value, settled) => {
    if (value) { errors[name] = value; } else { delete errors[name]; }
    if (settled) { list_errors(); }
    ask("errors", settled);
  });
  if (size) { size.line.replaceWith(made.line); }
  size = made;
}

function list_errors() {
  set_errors.replaceChildren(...Object.entries(errors).map(([name, value]) => element("button", {
    type: "button", textContent: `${name} ${+value.toFixed(3)} ${unit(name)}`,
    onclick: () => { names.value = name; choose(); } })));
  if (Object.keys(errors).length) {
    set_errors.append(element("button", { type: "button", textContent: "clear all", onclick: () => {
      Object.keys(errors).forEach(name => delete errors[name]);
      choose();
      list_errors();
      ask("errors", true);
    } }));
  }
}

if (names.options.length) {
  names.addEventListener("change", choose);
  choose();
  $("bench").append(element("h2", { textContent: "geometric errors, added to the model's" }), names, size.line, set_errors);
}
