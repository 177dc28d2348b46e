// For who watches: what to see, how fast, any moment of the episode again, and what it is worth.

import { headerOf } from "/web/scene.js";

const find = (id) => document.getElementById(id);
const KEPT = 256e6;  // bytes of frames that are kept; the oldest go first
const OVERLAYS = ["forces", "pressure", "vitals", "muscles"];
const BITS = 8e6;  // of a film [1/s]
const COLOURS = ["#0b5cad", "#a01818", "#17602b", "#8a5a00", "#6b2f8a", "#00717a"];

function save(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// Rows of a table: what, how much, and a bar for a share; without any the table is hidden.
function fill(id, rows) {
  find(id).parentElement.hidden = !rows.length;
  find(id).replaceChildren(...rows.map(([name, text, share]) => {
    const row = document.createElement("tr");
    const cell = Object.assign(document.createElement("td"), { textContent: text });
    if (share !== undefined) cell.append(" ", Object.assign(document.createElement("progress"), { value: share, ariaLabel: name }));
    row.append(Object.assign(document.createElement("th"), { scope: "row", textContent: name }), cell);
    return row;
  }));
}

export class Audience {
  constructor(scene, send, observe) {
    Object.assign(this, { scene, send, observe, frames: [], told: [], size: 0, isLive: true });
    find("watching").hidden = false;
    for (const name of OVERLAYS) find(`show-${name}`).addEventListener("change", () => this.show(this.at));
    find("take-picture").addEventListener("click", async () => save(await scene.picture(), "scene.png"));
    find("take-film").addEventListener("click", () => this.film());
    for (const id of ["clutch", "actions", "how"]) find(id).hidden = true;
    find("speed").addEventListener("input", () => {
      const speed = 2 ** Number(find("speed").value);
      find("speed-now").textContent = `${speed.toFixed(2)} times`;
      this.speed = speed;
      if (!this.replays) send({ type: "pace", speed });
    });
    find("moment").addEventListener("input", () => this.seek(Number(find("moment").value)));
    find("live").addEventListener("click", () => { this.seek(this.frames.length - 1); this.isLive = true; });
    this.speed = 1;
    requestAnimationFrame((time) => this.play(time));
    find("choice-form").addEventListener("submit", (event) => {
      event.preventDefault();
      const chosen = Object.fromEntries(new FormData(find("choice-form")));
      find("chosen").textContent = "building the scene: this takes some seconds";
      send({ type: "choice", ...chosen, seed: Number(chosen.seed) });
    });
  }

  static offer(choices, task) {
    for (const [name, values] of Object.entries(choices)) {
      const select = find("choice-form").elements[name];
      select.replaceChildren(...values.map((value) => new Option(value.replaceAll("_", " ") || "as the task has it", value)));
      if (name === "task") select.value = task;
    }
  }

  begin(facts) {
    Object.assign(this, { replays: facts.replays, cared: facts.cared, units: facts.vital_units, step: facts.control_dt, isPlaying: true });
    this.clear();
    for (const id of ["live", "choice-form"]) find(id).hidden = Boolean(this.replays);
    find("reset").hidden = this.replays === 1;
    const who = Object.entries(facts.cast).map(([role, name]) => `${role} is ${name}${facts.played[role] ? `, ${facts.played[role]}` : ""}`);
    find("chosen").textContent = who.join("; ");
  }

  clear() {
    const size = (this.base ?? []).reduce((sum, part) => sum + part.byteLength, 0);
    Object.assign(this, { frames: [], told: [], size, isLive: !this.replays, number: null, at: 0, due: 0 });
  }

  // A recorded episode comes as fast as it can be played, and is shown at the speed of the page.
  play(time) {
    requestAnimationFrame((next) => this.play(next));
    if (!this.replays || !this.isPlaying || time < this.due || this.at + 1 >= this.frames.length) return;
    this.due = Math.max(this.due, time - 100) + 1000 * this.step / this.speed;
    this.seek(this.at + 1);
    find("moment").value = this.at;
  }

  // Go on, or stop; from the end it begins again.
  toggle() {
    this.isPlaying = !this.isPlaying || this.at === this.told[0]?.steps;
    if (this.isPlaying && this.at === this.told[0]?.steps) this.seek(0);
    find("pause").setAttribute("aria-pressed", String(!this.isPlaying));
  }

  // Film the picture until it is asked again, then save the film.
  film() {
    const button = find("take-film");
    if (this.recorder) { this.recorder.stop(); return; }
    const recorder = this.recorder = new MediaRecorder(this.scene.canvas.captureStream(30), { mimeType: "video/webm", videoBitsPerSecond: BITS });
    const parts = [];
    recorder.addEventListener("dataavailable", ({ data }) => parts.push(data));
    recorder.addEventListener("stop", () => {
      for (const track of recorder.stream.getTracks()) track.stop();
      this.recorder = null;
      button.textContent = "Film";
      button.setAttribute("aria-pressed", "false");
      save(new Blob(parts, { type: "video/webm" }), "scene.webm");
    });
    recorder.start();
    this.scene.isDrawn = false;  // else a scene that rests gives no picture
    button.textContent = "Save the film";
    button.setAttribute("aria-pressed", "true");
  }

  // What came: shapes and surfaces, which all frames after them are of, or a frame.
  keep(buffer) {
    const { kind, number } = headerOf(buffer);
    this.size += buffer.byteLength;
    if (kind === "shapes") this.base = [buffer];
    else if (kind === "surface") this.base = Object.assign([...this.base], { [number + 1]: buffer });
    if (kind !== "frame") return;
    this.frames.push({ frame: buffer, base: this.base });
    while (this.size > KEPT && this.frames.length > 1) {
      const { frame, base } = this.frames.shift();
      for (const each of [frame, ...base.filter((part) => !this.frames[0].base.includes(part))]) this.size -= each.byteLength;
      this.told.shift();
    }
    find("moment").max = this.replays ? this.told.at(-1).steps : this.frames.length - 1;
    if (!this.isLive && !(this.replays && this.frames.length === 1)) return;
    find("moment").value = this.frames.length - 1;
    this.show(this.frames.length - 1);
  }

  // What is told comes before its frame.
  tell(data) {
    if (data.number === this.number) return;
    if (data.time < (this.told.at(-1)?.time ?? 0)) this.clear();
    this.number = data.number;
    this.told.push(data);
  }

  seek(k) {
    k = Math.min(k, this.frames.length - 1);  // of a record, what has come of it
    if (!this.frames[k]) return;
    this.isLive = !this.replays && k === this.frames.length - 1;
    this.show(k);
  }

  show(k) {
    const now = this.told[k];
    if (!now || !this.frames[k]) return;
    const { frame, base } = this.frames[k];
    const known = this.drawn?.[0] === base[0] ? this.drawn : [];
    base.forEach((part, i) => { if (part !== known[i]) this.scene.take(part); });
    this.drawn = base;
    if (frame !== this.shown) this.scene.take(this.shown = frame);
    this.at = k;
    const [forces, pressure, vitals, muscles] = OVERLAYS.map((name) => find(`show-${name}`).checked);
    find("moment-now").textContent = `${now.time.toFixed(1)} s`;
    this.scene.touch(forces ? now.touches : []);
    const most = this.scene.press(pressure ? now.touches : [], this.cared);
    this.observe(now.seen);
    if (this.replays) find("status").textContent = `${now.time.toFixed(1)} of ${(now.steps * this.step).toFixed(1)} s · seed ${now.seed} · force ${now.force_n.toFixed(1)} N`;
    find("outcome").textContent = (now.success ? "success" : now.is_over ? "over, no success" : "no success yet")
      + (pressure ? ` · skin pressed by at most ${(most / 1000).toFixed(1)} kPa` : "")
      + (this.replays ? ` · ${now.differs ? `differs from the record at ${now.differs}` : "as recorded"}` : "");
    const unit = (name) => (this.units[name] === "1" ? "" : ` ${this.units[name]}`);
    fill("vitals", vitals ? Object.entries(now.vitals).flatMap(([who, values]) => Object.entries(values)
      .map(([name, value]) => [`${who}: ${name.replaceAll("_", " ")}`, `${value.toFixed(1)}${unit(name)}`])) : []);
    fill("muscles", muscles ? Object.entries(now.muscles).flatMap(([who, values]) => (values.length
      ? values.map(([name, value]) => [`${who}: ${name.replaceAll("_", " ")}`, value.toFixed(2), value])
      : [[`${who}`, "moves by joint torques, without muscles"]])) : []);
    const rows = Object.entries({ ...now.rewards, "force [N]": now.force_n });
    find("terms").replaceChildren(...rows.map(([name, value], i) => {
      const row = document.createElement("tr");
      const head = Object.assign(document.createElement("th"), { scope: "row", textContent: name });
      head.style.borderLeft = `6px solid ${COLOURS[i % COLOURS.length]}`;
      row.append(head, Object.assign(document.createElement("td"), { textContent: value.toFixed(3) }));
      return row;
    }));
    this.plot(rows.map(([name]) => name), k);
  }

  // Each term over the episode, from its least to its greatest.
  plot(names, k) {
    const canvas = find("plot");
    const [width, height] = [canvas.width = canvas.clientWidth, canvas.height = canvas.clientHeight];
    const draw = canvas.getContext("2d");
    const x = (i) => (i / Math.max(this.told.length - 1, 1)) * width;
    names.forEach((name, c) => {
      const values = this.told.map((told) => (name === "force [N]" ? told.force_n : told.rewards[name] ?? 0));
      const [low, high] = [Math.min(...values), Math.max(...values)];
      draw.strokeStyle = COLOURS[c % COLOURS.length];
      draw.beginPath();
      values.forEach((value, i) => draw.lineTo(x(i), height - 3 - ((value - low) / (high - low || 1)) * (height - 6)));
      draw.stroke();
    });
    draw.fillStyle = "#16181b";
    draw.fillRect(x(k) - 0.5, 0, 1, height);
  }
}
