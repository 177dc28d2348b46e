// The page of a role: sends what a hand does 20 times a second, and shows the scene that comes back.

import { Audience } from '/web/audience.js';
import { Headset, isSupported } from '/web/headset.js';
import { Scene, isSoftware } from '/web/scene.js';

const RATE = 50;  // between two messages of a hand [ms]
const DRAG = 120;  // pixels of a drag that mean full speed
const STILL = 0.12;  // of a gamepad's stick, below which it rests
// Right, ahead and up as they are in the picture; then turns about these. Each by two keys, or a stick's axis.
const KEYS = [["KeyD", "KeyA"], ["KeyW", "KeyS"], ["KeyR", "KeyF"], ["KeyK", "KeyI"], ["KeyL", "KeyJ"], ["KeyU", "KeyO"]];
const STICKS = [[0, 0, 1], [1, 1, -1], [3, 2, -1], [2, 5, -1]];  // axis of the gamepad, which of these, sign

const find = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") ?? "";
const down = new Set();
let scene, headset, audience, socket, secret = token, acts = [], sliders = [], isTool = false;
let number = 0, held = false, drag = null, orbit = null, records = false, pauses = false, telling;

function trouble(text) {
  find("trouble").textContent = text;
  find("trouble").hidden = !text;
}

async function begin() {
  const answer = await fetch(`/setting?token=${encodeURIComponent(token)}`);
  if (!answer.ok) { trouble(await answer.text()); return; }
  const setting = await answer.json();
  secret = setting.token;
  find("title").textContent = `Teleoperation: ${setting.task.replaceAll("_", " ")}`;
  for (const [role, free] of Object.entries(setting.roles)) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = free ? role : `${role} (somebody plays)`;
    button.disabled = !free;
    button.addEventListener("click", () => join(role));
    find("roles").append(button, " ");
  }
  if (setting.choices) Audience.offer(setting.choices, setting.task);
  const free = Object.keys(setting.roles).filter((role) => setting.roles[role]);
  if (Object.keys(setting.roles).length === 1 && free.length === 1) join(free[0]);
}

function join(role) {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const query = new URLSearchParams({ role, token: secret, draws: isSoftware ? "coarse" : "fine" });
  socket = new WebSocket(`${scheme}://${location.host}/session?${query}`);
  socket.binaryType = "arraybuffer";
  socket.addEventListener("message", (event) => typeof event.data === "string" ? told(JSON.parse(event.data)) : drawn(event.data));
  socket.addEventListener("close", () => trouble("The scene is gone: start the command again and reload."));
  find("choice").hidden = true;
  find("stage").hidden = false;
}

function drawn(buffer) {
  if (audience) audience.keep(buffer);
  else scene?.take(buffer);
}

function told(data) {
  if (data.type === "refused") { trouble(data.why); return; }
  if (data.type === "facts") { furnish(data); return; }
  number = data.number;
  const words = {
    waiting: `waiting for ${data.missing.join(", ")}`, ready: audience ? "ready" : "ready: hold the clutch to begin", paused: "paused",
    running: "running", over: data.success ? "success" : "over, no success",
  };
  const lines = [
    `${words[data.status]} · ${data.time.toFixed(1)} s` + (audience ? "" : ` · delay ${data.latency_ms.toFixed(0)} ms`),
    `force ${data.force_n.toFixed(1)} N` + (records ? ` · ${data.recorded} recorded` : ""),
  ];
  if (!audience?.replays) find("status").textContent = lines.join(" · ");
  headset?.tell(number, data.body, lines);
  audience?.tell(data);
  pauses = data.status === "paused";
  if (!audience?.replays) find("pause").setAttribute("aria-pressed", String(pauses));
  if (!audience) observe(data.seen);
}

function observe(seen) {
  const rows = find("seen").rows;
  Object.entries(seen).forEach(([, values], i) => {
    if (rows[i]) rows[i].cells[1].textContent = values.map((value) => value.toFixed(2)).join("  ");
  });
}

function furnish(facts) {
  const watches = facts.shows !== facts.role;
  try {
    if (scene) scene.look(facts.camera);
    else {
      scene = window.teleoperation = new Scene(find("picture"), facts.camera);
      if (watches) audience = new Audience(scene, send, observe);
      embody(facts);
    }
  } catch (error) {
    trouble(`The scene cannot be drawn: this browser has no WebGL (${error.message}).`);
  }
  audience?.begin(facts);
  find("actions").replaceChildren();
  find("seen").replaceChildren();
  find("observes").open = !watches;
  find("seen-by").textContent = watches ? `What ${facts.shows} observes` : "What you observe";
  acts = facts.acts;
  records = facts.records;
  find("success").hidden = !records;
  isTool = acts.length >= 6 && acts[0].startsWith("tool x");
  find("title").textContent = `${facts.replays ? "Replay" : watches ? "Watching" : "Teleoperation"}: ${facts.task.replaceAll("_", " ")}`
    + (watches ? "" : `, ${facts.role}`);
  trouble("");
  sliders = acts.map((name, i) => {
    const label = document.createElement("label");
    const slider = Object.assign(document.createElement("input"), { type: "range", min: -1, max: 1, step: 0.01, value: 0 });
    const back = () => { slider.value = 0; slider.dataset.held = ""; };
    slider.addEventListener("pointerdown", () => { slider.dataset.held = "1"; });
    for (const name of ["pointerup", "pointercancel", "blur"]) slider.addEventListener(name, back);
    label.append(name, slider);
    find("actions").append(label);
    return slider;
  });
  for (const [name, unit] of Object.entries(facts.units)) {
    const row = find("seen").insertRow();
    const head = document.createElement("th");
    head.scope = "row";
    head.textContent = unit === "1" ? name : `${name} [${unit}]`;
    row.append(head);
    row.insertCell();
  }
  if (acts.length) telling ??= setInterval(tell, RATE);
}

async function embody(facts) {
  if (!await isSupported()) return;
  find("headset").hidden = false;
  find("headset").disabled = Boolean(facts.no_headset);
  find("headset").title = facts.no_headset;
  headset = new Headset(scene, {
    send: audience ? () => {} : send,
    wish: (wish) => command(wish === "pause" && pauses ? "go" : wish),
    ended: () => find("headset").setAttribute("aria-pressed", "false"),
  });
  find("headset").addEventListener("click", () => {
    if (headset.isOn) { headset.session.end(); return; }
    headset.enter().then(() => find("headset").setAttribute("aria-pressed", "true"), (error) => trouble(String(error)));
  });
}

// What keys, mouse, gamepad and sliders say together; each value from -1 to 1.
function action() {
  const values = sliders.map((slider) => Number(slider.value));
  let clutch = held || down.has("Space") || sliders.some((slider) => slider.dataset.held);
  const wanted = KEYS.map(([more, less]) => down.has(more) - down.has(less));
  if (drag) {
    clutch = true;
    wanted[0] += drag.x / DRAG;
    wanted[2] -= drag.y / DRAG;
  }
  for (const pad of navigator.getGamepads?.() ?? []) {
    if (!pad) continue;
    clutch ||= [4, 5, 6, 7].some((i) => pad.buttons[i]?.pressed);
    for (const [axis, which, sign] of STICKS) {
      const value = pad.axes[axis] ?? 0;
      if (Math.abs(value) > STILL) wanted[which] += sign * value;
    }
  }
  if (isTool) {
    const right = scene?.right() ?? [1, 0];  // from the picture's directions to those of the scene
    for (const at of [0, 3]) {
      values[at] += wanted[at] * right[0] - wanted[at + 1] * right[1];
      values[at + 1] += wanted[at] * right[1] + wanted[at + 1] * right[0];
      values[at + 2] += wanted[at + 2];
    }
  }
  return { clutch, values: values.map((value) => Math.max(-1, Math.min(1, value))) };
}

function send(data) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(data));
}

function tell() {
  if (headset?.isOn) return;
  const { clutch, values } = action();
  find("clutch").setAttribute("aria-pressed", String(clutch));
  send({ type: "hand", seen: number, clutch, values });
}

function command(wish) {
  send({ type: "command", wish });
}

const typing = (event) => event.target instanceof HTMLInputElement && event.target.type !== "range";
addEventListener("keydown", (event) => {
  if (typing(event) || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.code === "Space" && !(event.target instanceof HTMLButtonElement && event.target.id !== "clutch")) event.preventDefault();
  down.add(event.code);
});
addEventListener("keyup", (event) => down.delete(event.code));
addEventListener("blur", () => { down.clear(); held = false; drag = null; });
document.addEventListener("visibilitychange", () => { if (document.hidden) { down.clear(); held = false; drag = null; } });

find("clutch").addEventListener("pointerdown", () => { held = true; });
for (const name of ["pointerup", "pointercancel", "pointerleave"]) find("clutch").addEventListener(name, () => { held = false; });
find("pause").addEventListener("click", () => { if (audience?.replays) audience.toggle(); else command(pauses ? "go" : "pause"); });
find("reset").addEventListener("click", () => command("reset"));
find("success").addEventListener("click", () => command("success"));

const canvas = find("picture");
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  const start = { at: [event.clientX, event.clientY], x: 0, y: 0 };
  if (event.button === 2) orbit = { ...start, ...{ turned: scene.view.turned, raised: scene.view.raised } };
  else drag = start;
});
canvas.addEventListener("pointermove", (event) => {
  const shift = (from) => [event.clientX - from.at[0], event.clientY - from.at[1]];
  if (drag) [drag.x, drag.y] = shift(drag);
  if (orbit) {
    const [x, y] = shift(orbit);
    scene.view.turned = ((orbit.turned - x / 3 + 540) % 360) - 180;
    scene.view.raised = Math.max(-60, Math.min(60, orbit.raised + y / 4));
  }
});
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { drag = orbit = null; });
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  scene.view.nearness = Math.max(0.3, Math.min(3, scene.view.nearness * Math.exp(-event.deltaY / 600)));
}, { passive: false });

begin().catch((error) => trouble(String(error)));
