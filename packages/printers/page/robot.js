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
    this.law = "joint";
    this.unit = of.coordinates.some(({ unit }) => unit === "m") ? "m" : "rad"; // of errors
    this.view = { azimuth: -0.9, elevation: 0.45 };
    const { minimum, maximum } = of.workspace;
    this.box = of.home.map((at, k) => (minimum[k] < maximum[k] ? [minimum[k], maximum[k]]
      : [at - 0.05, at + 0.05])); // a file without a workspace
    this.build(place);
    this.choose();
  }
  named(name) { return this.of.parameters.find((each) => each.name === name); }

  build(place) {
    const { of } = this;
    this.picture = svg("svg", { viewBox: "0 0 480 400", class: "view", role: "img",
      "aria-label": `${of.title}: desired pose dashed, true pose solid` });
    this.picture.addEventListener("pointerdown", (event) => this.drag(event));
    this.sliders = of.coordinates.map(({ name, unit }, k) => this.slider(name, unit, ...this.box[k],
      () => this.desired[k], (value) => { this.desired[k] = value; this.show(); }));
    this.choice = h("select", { ariaLabel: "Parameter in error", onchange: () => this.choose() },
      of.parameters.map(({ name }) => h("option", { value: name }, name)));
    this.choice.value = Object.keys(this.errors)[0];
    this.wrong = h("div");
    this.broken = h("span");
    this.laws = h("select", { ariaLabel: "Control law", onchange: () => { this.law = this.laws.value; this.show(); } },
      h("option", { value: "joint" }, "motors alone"), h("option", { value: "tej" }, "motors and sensors (TEJ)"),
      h("option", { value: "estimated" }, "all readings, weighted"));
    this.reading = h("div"), this.error = h("p", { className: "verdict" }), this.said = h("p", { role: "status" });
    this.poses = h("input", { type: "number", min: 2, max: 500, value: 40, id: `poses-${of.name}` });
    this.fitted = h("div");
    const undo = h("button", { type: "button", onclick: () => { this.model = this.start; this.fitted.replaceChildren(); this.show(); } },
      "Undo");
    place.replaceChildren(h("div", { className: "columns" },
      h("figure", {}, this.picture, h("figcaption", {},
        "Dashed: desired. Solid: true, its error drawn 20 times larger. Drag the platform; drag elsewhere to turn the view.")),
      h("div", {},
        h("h3", {}, "Desired pose"), this.sliders.map(({ row }) => row),
        h("h3", {}, "Error of the true robot"), h("div", { className: "row" }, this.choice,
          h("button", { type: "button", onclick: () => { this.errors = {}; this.choose(); } }, "No error")), this.wrong, this.broken,
        h("h3", {}, "Control"), this.laws, this.error, this.said)),
    h("h3", {}, "Readings"), this.reading,
    h("h3", {}, "Calibration"),
    h("div", { className: "row" }, h("label", { htmlFor: this.poses.id }, "Poses"), this.poses,
      h("button", { type: "button", onclick: () => this.learn() }, "Simulate a log and calibrate"), undo), this.fitted);
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
    this.broken.textContent = changed.map(([of, by]) => `${of} ${by > 0 ? "+" : ""}${inPrint(by, this.named(of).unit, 2)}`).join(", ");
    try {
      const truth = this.drawn.with(changed.map(([of, by]) => [of, this.named(of).value + by]));
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
      const at = this.model.settle(this.truth, this.desired, this.law);
      const expected = this.model.readings(this.desired);
      this.reading.replaceChildren(table(["reading", "expected", "true robot", "difference"], this.of.readings.map(({ name, unit }, k) => {
        const off = at.readings[k] - expected[k];
        return [name, inPrint(expected[k], unit), inPrint(at.readings[k], unit),
          { text: inPrint(off, unit), kind: Math.abs(off) > 3 * this.of.sigma[k] ? "bad" : "" }];
      })));
      const off = at.x.map((value, k) => value - this.desired[k]);
      this.error.textContent = "Error of the platform: " + this.errorText(off);
      this.said.textContent = "";
      this.draw(off);
    } catch (error) {
      this.said.textContent = `No pose here: ${error.message}.`;
    }
  }
  // Distance of two positions, or of two orientations of a robot without a position.
  distance(x, y) {
    return Math.hypot(...this.of.coordinates.map(({ unit }, k) => (unit === this.unit ? x[k] - y[k] : 0)));
  }
  // Position as a distance, angles one by one.
  errorText(off) {
    const angles = this.of.coordinates.flatMap(({ name, unit }, k) => (unit === "rad" ? [`${name} ${inPrint(off[k], unit)}`] : []));
    return [...(this.unit === "m" ? [inPrint(this.distance(off, off.map(() => 0)), "m")] : []), ...angles].join(", ");
  }

  // Points of the model at a pose: arms, rods, platform; m.
  points(x) {
    const q = this.start.ikm(x), frame = this.start.frame(x), D = frame.slice(0, 3), R = frame.slice(3);
    const turned = (v) => [0, 1, 2].map((i) => R[3 * i] * v[0] + R[3 * i + 1] * v[1] + R[3 * i + 2] * v[2]);
    return this.of.chains.map((chain, i) => {
      const { base, axis: e, zero: u, arm } = chain, motor = (q[i] + chain.encoder_offset) / chain.encoder_gain;
      const side = [e[1] * u[2] - e[2] * u[1], e[2] * u[0] - e[0] * u[2], e[0] * u[1] - e[1] * u[0]];
      const away = [(k) => arm * (Math.cos(motor) * u[k] + Math.sin(motor) * side[k]), (k) => motor * e[k], () => 0][chain.actuator];
      const pivot = turned(chain.pivot);
      return { base, elbow: base.map((b, k) => b + away(k)), anchor: D.map((d, k) => d + pivot[k] + chain.anchor[k]) };
    });
  }

  draw(off) {
    const { azimuth, elevation } = this.view, size = this.size ??= this.extent();
    const right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
    const up = [-Math.cos(azimuth) * Math.sin(elevation), -Math.sin(azimuth) * Math.sin(elevation), Math.cos(elevation)];
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const at = (p) => p.map((value, k) => value - size.centre[k]);
    const flat = (p) => [240 + size.scale * dot(right, at(p)), 200 - size.scale * dot(up, at(p))].map((v) => v.toFixed(1));
    const line = (kind, a, b) => { const [x1, y1] = flat(a), [x2, y2] = flat(b); return svg("line", { class: kind, x1, y1, x2, y2 }); };
    const polygon = (kind, all) => {
      const centre = [0, 1, 2].map((k) => all.reduce((sum, p) => sum + p[k], 0) / all.length);
      const turn = (p) => Math.atan2(p[1] - centre[1], p[0] - centre[0]);
      return svg("polygon", { class: kind, points: [...all].sort((a, b) => turn(a) - turn(b)).map((p) => flat(p).join()).join(" ") });
    };
    let shown;
    for (const times of [20, 1, 0]) // the exaggerated pose may be out of reach
      try { shown = this.points(this.desired.map((value, k) => value + times * off[k])); break; } catch { /* the next */ }
    if (!shown) return;
    this.picture.replaceChildren(
      polygon("base", shown.map(({ base }) => base)),
      ...shown.flatMap(({ base, elbow, anchor }) => [line("arm", base, elbow), line("rod", elbow, anchor)]),
      polygon("platform", shown.map(({ anchor }) => anchor)),
      polygon("desired", this.points(this.desired).map(({ anchor }) => anchor)));
  }
  extent() {
    const all = this.points(this.of.home).flatMap(({ base, elbow, anchor }) => [base, elbow, anchor]);
    const bounds = [0, 1, 2].map((k) => all.map((p) => p[k])).map((v) => [Math.min(...v), Math.max(...v)]);
    const diagonal = Math.hypot(...bounds.map(([low, high]) => high - low));
    return { centre: bounds.map(([low, high]) => (low + high) / 2), scale: Math.min(470 / diagonal, 360 / (bounds[2][1] - bounds[2][0])) };
  }

  drag(event) {
    const names = this.of.coordinates.map(({ name }) => name), [ix, iy] = [names.indexOf("x"), names.indexOf("y")];
    const moves = event.target.classList.contains("platform") && ix >= 0 && iy >= 0;
    let last = event;
    const on = (next) => {
      const per = 480 / this.picture.clientWidth, dx = per * (next.clientX - last.clientX), dy = per * (next.clientY - last.clientY);
      last = next;
      const { azimuth: a, elevation } = this.view;
      if (moves) {
        const u = dx / this.size.scale, v = dy / this.size.scale / Math.max(0.2, Math.sin(elevation));
        const clamp = (k, by) => { this.desired[k] = Math.min(this.box[k][1], Math.max(this.box[k][0], this.desired[k] + by)); };
        clamp(ix, -Math.sin(a) * u + Math.cos(a) * v);
        clamp(iy, Math.cos(a) * u + Math.sin(a) * v);
      } else {
        this.view.azimuth -= 0.01 * dx;
        this.view.elevation = Math.min(1.5, Math.max(-0.2, elevation + 0.01 * dy));
      }
      this.show();
    };
    this.picture.setPointerCapture(event.pointerId);
    this.picture.onpointermove = on;
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
  simulated(count, seed = 1) {
    const { normal } = generator(seed + 1000);
    return this.random(count, seed).map((x) => this.truth.readings(x).map((value, k) => value + this.of.sigma[k] * normal()));
  }
  // The rms error over random poses under the law.
  accuracy(model) {
    const off = this.random(60, 7).flatMap((x) => {
      try { return [this.distance(model.settle(this.truth, x, this.law).x, x)]; } catch { return []; } // out of this model's reach
    });
    return inPrint(Math.hypot(...off) / Math.sqrt(off.length), this.unit);
  }

  learn() {
    try {
      const rows = this.simulated(Math.round(this.poses.valueAsNumber)), fit = this.drawn.calibrate(rows);
      const before = this.accuracy(this.start);
      this.use(fit);
      this.fitted.replaceChildren(
        h("p", { className: "verdict" }, `Error over the workspace: ${before} rms before, ${this.accuracy(this.model)} after.`),
        h("p", {}, `${rows.length} poses, readings with their own noise; the poses themselves are unknown. The robot above now has the calibrated model.`),
        this.parameters(fit, true));
      this.lastFit = { rows, fit };
    } catch (error) {
      this.fitted.replaceChildren(h("p", { className: "bad" }, `No calibration: ${error.message}.`));
    }
    this.show();
  }
  use(fit) {
    if (this.model !== this.start) this.model.free();
    this.model = this.drawn.with(fit.parameters.map(({ name, value }) => [name, value]));
  }
  // By the change in units of the prior σ; the first ten, then all.
  parameters(fit, known = false) {
    const before = (name) => this.named(name).value;
    const moved = ({ name, value, prior }) => Math.abs(value - before(name)) / prior;
    const sorted = [...fit.parameters].sort((a, b) => moved(b) - moved(a));
    const row = ({ name, unit, value, sigma, prior }) => [name, inPrint(before(name), unit),
      ...(known ? [inPrint(before(name) + (this.errors[name] ?? 0), unit)] : []), inPrint(value, unit), inPrint(sigma, unit), verdict(sigma / prior)];
    const heads = ["parameter", "before", ...(known ? ["true"] : []), "identified", "σ", "verdict"];
    return h("div", {}, table(heads, sorted.slice(0, 8).map(row)),
      h("details", {}, h("summary", {}, `All ${sorted.length} parameters`), table(heads, fit.parameters.map(row))));
  }

  // Calibration by a log: rows of this robot's readings, as CSV.
  readLog(text) {
    const rows = logOf(text, this.of);
    let fit;
    try {
      fit = this.drawn.calibrate(rows);
    } catch (error) {
      throw new Error(`${rows.length} rows: ${error.message}; are the readings in m and rad, and of this robot?`);
    }
    this.use(fit);
    this.show();
    this.lastFit = { rows, fit };
    const left = fit.status.flatMap((status, k) => (status ? [k + 1] : []));
    return h("div", {},
      h("p", { className: "verdict" }, `${fit.used} of ${rows.length} rows used; residuals ${fixed(fit.rms, 2)} times their σ.`),
      fit.rms > 2 ? h("p", { className: "bad" }, "The readings disagree by more than their noise: check units, columns, tolerances; truepose calibrate looks for the cause.") : "",
      left.length ? h("p", {}, `Rows out of the robot's reach: ${left.join(", ")}.`) : "",
      this.parameters(fit),
      download(`${this.of.name}-identified.json`, JSON.stringify(fit.parameters, null, 1), "Save the parameters"));
  }
}

// Rows of readings from CSV with a heading; columns in any order, an empty field is not read.
function logOf(text, of) {
  const lines = text.split(/\r?\n/).filter((line) => line.trim() && !line.startsWith("#"));
  const fields = (line) => line.split(/[,;\t]/).map((field) => field.trim().replace(/^"|"$/g, ""));
  const heads = fields(lines[0] ?? ""), at = of.readings.map(({ name }) => heads.indexOf(name));
  const missing = of.readings.filter((_, k) => at[k] < 0).map(({ name }) => name);
  if (missing.length) throw new Error(`the log has no column ${missing.join(", ")}; ${of.name} needs ${of.readings.map(({ name }) => name).join(", ")}, in m and rad`);
  return lines.slice(1).map((line, k) => {
    const row = fields(line);
    return at.map((column, j) => {
      const field = row[column] ?? "", value = field === "" || /^nan$/i.test(field) ? NaN : Number(field);
      if (field !== "" && Number.isNaN(value) && !/^nan$/i.test(field))
        throw new Error(`row ${k + 1}, ${of.readings[j].name}: "${field.slice(0, 20)}" is no number`);
      return value;
    });
  });
}
