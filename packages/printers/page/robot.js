// A robot with errors that one can move, break and calibrate; and calibration by a log of its readings.
"use strict";

class Workbench {
  constructor(of, place) {
    this.of = of;
    this.drawn = new Robot(of); // nominal, of which a calibration makes others
    this.start = this.model = this.drawn.with(of.parameters.map(({ name, value }) => [name, value]));
    const rods = of.parameters.filter(({ name }) => name.endsWith(".rod"));
    const { name, unit } = rods.find((each) => each.name === "chain3.rod") ?? rods[0] ?? of.parameters[0];
    this.errors = { [name]: unit === "m" ? -0.003 : 0.01 };
    this.desired = [...of.home];
    this.unit = of.coordinates.some(({ unit }) => unit === "m") ? "m" : "rad"; // of errors
    this.view = { azimuth: -0.9, elevation: 0.45 };
    this.box = of.home.map((_, k) => [of.workspace.minimum[k], of.workspace.maximum[k]]);
    this.build(place);
    this.choice.value = name;
    this.choose();
  }
  named(name) { return this.of.parameters.find((each) => each.name === name); }

  build(place) {
    const { of } = this;
    this.picture = h("svg", { viewBox: "0 0 480 400", class: "view", role: "img",
      "aria-label": `${of.title}: desired pose dashed, true pose solid` });
    this.picture.onpointerdown = (event) => this.drag(event);
    this.sliders = of.coordinates.map(({ name, unit }, k) => this.slider(name, unit, ...this.box[k],
      () => this.desired[k], (value) => { this.desired[k] = value; this.show(); }));
    this.choice = h("select", { ariaLabel: "Parameter in error", onchange: () => this.choose() },
      of.parameters.map(({ name }) => h("option", {}, name)));
    const laws = { joint: "motors alone", tej: "motors and sensors (TEJ)", estimated: "all readings, weighted" };
    this.law = h("select", { ariaLabel: "Control law", onchange: () => this.show() },
      Object.entries(laws).map(([value, title]) => h("option", { value }, title)));
    this.wrong = h("div"), this.broken = h("span"), this.reading = h("div"), this.fitted = h("div");
    this.error = h("p", { className: "verdict" }), this.said = h("p", { role: "status" });
    this.poses = h("input", { type: "number", min: 2, max: 500, value: 40, ariaLabel: "Poses" });
    place.replaceChildren(h("div", { className: "columns" },
      h("figure", {}, this.picture, h("figcaption", {},
        "Dashed: desired. Solid: true, its error drawn 20 times larger. Drag the platform; drag elsewhere to turn the view.")),
      h("div", {},
        h("h3", {}, "Desired pose"), this.sliders.map(({ row }) => row),
        h("h3", {}, "Error of the true robot"), this.choice, " ", button("No error", () => { this.errors = {}; this.choose(); }),
        this.wrong, this.broken, h("h3", {}, "Control"), this.law, this.error, this.said)),
    h("h3", {}, "Readings"), this.reading,
    h("h3", {}, "Calibration"), this.poses, " poses ", button("Simulate a log and calibrate", () => this.learn()), " ",
    button("Undo", () => { this.use(this.start); this.fitted.replaceChildren(); this.show(); }), this.fitted);
  }

  slider(name, unit, low, high, get, set) {
    const [factor] = UNITS[unit], shown = h("output");
    const input = h("input", { type: "range", min: factor * low, max: factor * high, step: factor * (high - low) / 200,
      ariaLabel: name, oninput: () => { set(input.valueAsNumber / factor); update(); } });
    const update = () => { input.value = factor * get(); shown.textContent = inPrint(get(), unit, 2); };
    update();
    return { row: h("div", { className: "slider" }, h("span", {}, name), input, shown), update };
  }

  // A slider for the chosen parameter's error.
  choose() {
    const name = this.choice.value, { unit } = this.named(name), most = unit === "rad" ? 0.05 : 0.01;
    this.wrong.replaceChildren(this.slider("error", unit, -most, most, () => this.errors[name] ?? 0, (value) => {
      this.errors[name] = value;
      this.breakIt();
    }).row);
    this.breakIt();
  }
  // A true robot with the chosen errors.
  breakIt() {
    const changed = Object.entries(this.errors).filter(([, by]) => by !== 0);
    this.broken.textContent = changed.map(([name, by]) => `${name} ${by > 0 ? "+" : ""}${inPrint(by, this.named(name).unit, 2)}`).join(", ");
    try {
      const truth = this.drawn.with(changed.map(([name, by]) => [name, this.named(name).value + by]));
      this.truth?.free();
      this.truth = truth;
      this.show();
    } catch (error) {
      this.said.textContent = `With this error there is no robot: ${error.message}.`;
    }
  }

  show() {
    this.sliders.forEach(({ update }) => update());
    try {
      const at = this.model.settle(this.truth, this.desired, this.law.value), expected = this.model.readings(this.desired);
      this.reading.replaceChildren(table(["reading", "expected", "true robot", "difference"], this.of.readings.map(({ name, unit }, k) => {
        const off = at.readings[k] - expected[k];
        return [name, inPrint(expected[k], unit), inPrint(at.readings[k], unit),
          { text: inPrint(off, unit), kind: Math.abs(off) > 3 * this.of.sigma[k] ? "bad" : "" }];
      })));
      const off = at.x.map((value, k) => value - this.desired[k]);
      const angles = this.of.coordinates.flatMap(({ name, unit }, k) => (unit === "rad" ? [`${name} ${inPrint(off[k], unit)}`] : []));
      const position = this.unit === "m" ? [inPrint(this.size(off), "m")] : [];
      this.error.textContent = `Error of the platform: ${[...position, ...angles].join(", ")}`;
      this.said.textContent = "";
      this.draw(off);
    } catch (error) {
      this.said.textContent = `No pose here: ${error.message}.`;
    }
  }
  // Of an error of the position, or of the orientation of a robot without a position.
  size(off) { return Math.hypot(...this.of.coordinates.map(({ unit }, k) => (unit === this.unit ? off[k] : 0))); }

  // Points of the model at a pose: of each chain its base, elbow and platform anchor; m.
  points(x) {
    const q = this.start.ikm(x), frame = this.start.frame(x);
    return this.of.chains.map((chain, i) => {
      const { base, axis: e, zero: u, arm, pivot } = chain, motor = (q[i] + chain.encoder_offset) / chain.encoder_gain;
      const side = [e[1] * u[2] - e[2] * u[1], e[2] * u[0] - e[0] * u[2], e[0] * u[1] - e[1] * u[0]];
      const away = [(k) => arm * (Math.cos(motor) * u[k] + Math.sin(motor) * side[k]), (k) => motor * e[k], () => 0][chain.actuator];
      return [base, base.map((b, k) => b + away(k)), base.map((_, k) => frame[k] + chain.anchor[k] + dot(frame.slice(3 * k + 3), pivot))];
    });
  }

  draw(off) {
    const { azimuth: a, elevation: b } = this.view, { centre, scale } = this.extent ??= this.measured();
    const right = [-Math.sin(a), Math.cos(a), 0], up = [-Math.cos(a) * Math.sin(b), -Math.sin(a) * Math.sin(b), Math.cos(b)];
    const flat = (p) => [[240, scale, right], [200, -scale, up]].map(([at, by, along]) => (at + by * (dot(along, p) - dot(along, centre))).toFixed(1));
    const line = (kind, from, to) => { const [x1, y1] = flat(from), [x2, y2] = flat(to); return h("line", { class: kind, x1, y1, x2, y2 }); };
    const polygon = (kind, all) => {
      const [x, y] = mean(all), turn = (p) => Math.atan2(p[1] - y, p[0] - x);
      return h("polygon", { class: kind, points: all.toSorted((p, q) => turn(p) - turn(q)).map((p) => flat(p).join()).join(" ") });
    };
    for (const times of [20, 1, 0]) // the exaggerated pose may be out of reach
      try {
        const shown = this.points(this.desired.map((value, k) => value + times * off[k])), column = (k) => shown.map((points) => points[k]);
        this.picture.replaceChildren(polygon("base", column(0)),
          ...shown.flatMap(([base, elbow, anchor]) => [line("arm", base, elbow), line("rod", elbow, anchor)]),
          polygon("platform", column(2)), polygon("desired", this.points(this.desired).map(([, , anchor]) => anchor)));
        return;
      } catch { /* the next */ }
  }
  // Centre of the robot, and pixels per metre that show all of it.
  measured() {
    const all = this.points(this.of.home).flat(), centre = mean(all);
    return { centre, scale: 190 / Math.max(...all.map((p) => Math.hypot(...p.map((value, k) => value - centre[k])))) };
  }

  drag(event) {
    const [ix, iy] = ["x", "y"].map((name) => this.of.coordinates.findIndex((each) => each.name === name));
    const moves = event.target.classList.contains("platform") && ix >= 0 && iy >= 0;
    let last = event;
    this.picture.setPointerCapture(event.pointerId);
    this.picture.onpointermove = (next) => {
      const per = 480 / this.picture.clientWidth, dx = per * (next.clientX - last.clientX), dy = per * (next.clientY - last.clientY);
      last = next;
      const { azimuth: a, elevation } = this.view, clamp = (low, value, high) => Math.min(high, Math.max(low, value));
      if (moves) {
        const u = dx / this.extent.scale, v = dy / this.extent.scale / Math.max(0.2, Math.sin(elevation));
        for (const [k, by] of [[ix, Math.cos(a) * v - Math.sin(a) * u], [iy, Math.cos(a) * u + Math.sin(a) * v]])
          this.desired[k] = clamp(this.box[k][0], this.desired[k] + by, this.box[k][1]);
      } else {
        this.view = { azimuth: a - 0.01 * dx, elevation: clamp(-0.2, elevation + 0.01 * dy, 1.5) };
      }
      this.show();
    };
    this.picture.onpointerup = this.picture.onpointercancel = () => { this.picture.onpointermove = null; };
  }

  // Poses all over the workspace, each in reach of both robots.
  random(count, seed) {
    const { uniform } = generator(seed), poses = [];
    for (let tries = 0; poses.length < count && tries < 50 * count; ++tries) {
      const x = this.box.map(([low, high]) => low + (high - low) * uniform());
      try { this.truth.readings(x); this.truth.fkm(this.start.ikm(x), x); poses.push(x); } catch { /* out of reach */ }
    }
    return poses;
  }
  // The rms error over random poses under the law.
  accuracy() {
    const off = this.random(60, 7).flatMap((x) => {
      try { return [this.size(this.model.settle(this.truth, x, this.law.value).x.map((value, k) => value - x[k]))]; } catch { return []; } // out of this model's reach
    });
    return inPrint(Math.hypot(...off) / Math.sqrt(off.length), this.unit);
  }

  // Calibrate the nominal robot by rows of readings, and use the result.
  fit(rows) {
    const fit = this.drawn.calibrate(rows);
    this.use(this.drawn.with(fit.parameters.map(({ name, value }) => [name, value])));
    this.lastFit = { rows, fit };
    return fit;
  }
  use(model) {
    if (this.model !== this.start) this.model.free();
    this.model = model;
  }
  learn() {
    try {
      const { normal } = generator(1001);
      const rows = this.random(Math.round(this.poses.valueAsNumber), 1).map((x) => this.truth.readings(x).map((value, k) => value + this.of.sigma[k] * normal()));
      this.use(this.start);
      const before = this.accuracy(), fit = this.fit(rows);
      this.fitted.replaceChildren(
        h("p", { className: "verdict" }, `Error over the workspace: ${before} rms before, ${this.accuracy()} after.`),
        h("p", {}, `${rows.length} poses, readings with their own noise; the poses themselves are unknown. The robot above now has the calibrated model.`),
        ...this.parameters(fit, true));
    } catch (error) {
      this.fitted.replaceChildren(h("p", { className: "bad" }, `No calibration: ${error.message}.`));
    }
    this.show();
  }
  // By the change in units of the prior σ: the first eight, then the others.
  parameters(fit, known = false) {
    const before = (name) => this.named(name).value, heads = ["parameter", "before", ...(known ? ["true"] : []), "identified", "σ", "verdict"];
    const moved = ({ name, value, prior }) => Math.abs(value - before(name)) / prior;
    const rows = fit.parameters.toSorted((a, b) => moved(b) - moved(a)).map(({ name, unit, value, sigma, prior }) => [name, inPrint(before(name), unit),
      ...(known ? [inPrint(before(name) + (this.errors[name] ?? 0), unit)] : []), inPrint(value, unit), inPrint(sigma, unit), sigma <= 0.3 * prior ? "identified" : sigma <= 0.9 * prior ? "barely" : "not identified"]);
    return [table(heads, rows.slice(0, 8)), details("Other parameters", table(heads, rows.slice(8)))];
  }

  // Calibration by a log: rows of this robot's readings, as CSV.
  readLog(text) {
    const rows = logOf(text, this.of);
    let fit;
    try {
      fit = this.fit(rows);
    } catch (error) {
      throw new Error(`${rows.length} rows: ${error.message}; are the readings in m and rad, and of this robot?`);
    }
    this.show();
    const left = fit.status.flatMap((status, k) => (status ? [k + 1] : []));
    return [
      h("p", { className: "verdict" }, `${fit.used} of ${rows.length} rows used; residuals ${fixed(fit.rms, 2)} times their σ.`),
      fit.rms > 2 ? h("p", { className: "bad" }, "The readings disagree by more than their noise: check units, columns, tolerances; truepose calibrate looks for the cause.") : "",
      left.length ? h("p", {}, `Rows out of the robot's reach: ${left.join(", ")}.`) : "",
      ...this.parameters(fit),
      download(`${this.of.name}-identified.json`, JSON.stringify(fit.parameters, null, 1), "Save the parameters")];
  }
}

const mean = (points) => [0, 1, 2].map((k) => points.reduce((sum, p) => sum + p[k], 0) / points.length);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// Rows of readings from CSV with a heading; columns in any order, an empty field is not read.
function logOf(text, { name, readings }) {
  const lines = text.split(/\r?\n/).filter((line) => line.trim() && !line.startsWith("#"));
  const [heads, ...rows] = lines.map((line) => line.split(/[,;\t]/).map((field) => field.trim().replace(/^"|"$/g, "")));
  const missing = readings.filter((each) => !heads.includes(each.name)), names = (of) => of.map((each) => each.name).join(", ");
  if (missing.length) throw new Error(`the log has no column ${names(missing)}; ${name} needs ${names(readings)}, in m and rad`);
  return rows.map((row, k) => readings.map((reading) => {
    const field = row[heads.indexOf(reading.name)] ?? "", empty = /^(nan)?$/i.test(field), value = empty ? NaN : Number(field);
    if (Number.isNaN(value) && !empty) throw new Error(`row ${k + 1}, ${reading.name}: "${field.slice(0, 20)}" is no number`);
    return value;
  }));
}
