// For who watches: what to see, how fast, any moment of the episode again, and what it is worth.

const find = (id) => document.getElementById(id);
const KEPT = 256e6;  // bytes of frames that are kept; the oldest go first
const COLOURS = ["#0b5cad", "#a01818", "#17602b", "#8a5a00", "#6b2f8a", "#00717a"];

export class Audience {
  constructor(scene, send) {
    Object.assign(this, { scene, send, frames: [], told: [], size: 0, isLive: true });
    find("watching").hidden = false;
    for (const id of ["clutch", "actions", "how"]) find(id).hidden = true;
    find("speed").addEventListener("input", () => {
      const speed = 2 ** Number(find("speed").value);
      find("speed-now").textContent = `${speed.toFixed(2)} times`;
      send({ type: "pace", speed });
    });
    find("moment").addEventListener("input", () => this.seek(Number(find("moment").value)));
    find("live").addEventListener("click", () => { this.seek(this.frames.length - 1); this.isLive = true; });
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
    this.clear();
    const who = Object.entries(facts.cast).map(([role, name]) => `${role} is ${name}${facts.played[role] ? `, ${facts.played[role]}` : ""}`);
    find("chosen").textContent = who.join("; ");
  }

  clear() {
    Object.assign(this, { frames: [], told: [], size: 0, isLive: true, number: null });
  }

  // A frame that came; return whether it is to be shown now.
  keep(buffer) {
    this.frames.push(buffer);
    this.size += buffer.byteLength;
    while (this.size > KEPT) { this.size -= this.frames.shift().byteLength; this.told.shift(); }
    find("moment").max = this.frames.length - 1;
    if (this.isLive) find("moment").value = this.frames.length - 1;
    return this.isLive;
  }

  // What is told comes before its frame.
  tell(data) {
    if (data.number === this.number) return;
    if (data.time < (this.told.at(-1)?.time ?? 0)) this.clear();
    this.number = data.number;
    this.told.push(data);
    if (this.isLive) this.show(this.told.length - 1);
  }

  seek(k) {
    if (!this.frames[k]) return;
    this.isLive = k === this.frames.length - 1;
    this.scene.take(this.frames[k]);
    this.show(k);
  }

  show(k) {
    const now = this.told[k];
    if (!now) return;
    find("moment-now").textContent = `${now.time.toFixed(1)} s`;
    this.scene.touch(now.touches);
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
