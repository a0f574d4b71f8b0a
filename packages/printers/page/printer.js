// Calibration of a delta printer: truepose_printer(), text in, JSON out, shown as tables and a map.
"use strict";

const MOST_ANSWER = 1 << 24; // bytes

// Its answer. Options in mm: arm, probe radius; number of next points; heights alone (0, 1); then eight σ, 0: as usual.
function printerAnswer(text, options) {
  return core.within((put, room) => {
    const bytes = new TextEncoder().encode(text), json = room(MOST_ANSWER / 8);
    const used = core.c.truepose_printer(put(bytes), bytes.length, put(options), json, MOST_ANSWER);
    return JSON.parse(new TextDecoder().decode(core.bytes(json, used)));
  });
}

function printerResult(of, name) {
  if (!of.readings) return [list([...of.notes, ...of.assumptions]), planOf(of)]; // a configuration without readings
  const outlier = of.readings.find(({ outlier }) => outlier);
  return [
    h("p", { className: `verdict ${of.rely ? "" : "bad"}` }, of.verdict),
    list(of.words.filter((each) => each !== of.verdict)),
    outlier ? h("p", { className: "bad" }, `Outlier: ${outlier.name}.`) : "",
    list(of.notes),
    h("h3", {}, "Parameters"), table(["parameter", "now", "estimate", "σ", "verdict", of.kind === "klipper" ? "Klipper's" : "fit"], of.parameters.map((each) =>
      [`${each.name} (${each.unit})`, each.now, each.estimate, each.sigma, each.verdict, each.klipper])),
    h("h3", {}, "Height of the nozzle over the bed"), bedMaps(of.bed),
    h("h3", {}, "Readings left over"), ...residualsOf(of),
    linesOf(of, name),
    ...(of.plan.length ? [h("h3", {}, "What to measure next"), planOf(of)] : []),
    details("Assumptions", list(of.assumptions)),
  ];
}

// What to paste or send; open where the decision recommends it.
function linesOf(of, name) {
  const recommended = /[Uu]se the estimate:?/.test(of.verdict) && of.rely, text = of.lines.join("\n");
  const title = of.kind === "klipper" ? "Lines for printer.cfg" : "Lines to send";
  const copy = button("Copy", () => navigator.clipboard.writeText(text).then(
    () => { copy.textContent = "Copied"; }, () => { copy.textContent = "Not allowed: select and copy"; }));
  const after = "After new parameters measure the Z offset and the mesh of the bed again.";
  const shown = details(recommended ? title : `${title}: not recommended, see the decision above`, h("pre", {}, text), copy, " ",
    of.config ? download(name.replace(/(\.\w+)?$/, "-new.cfg"), of.config, "Save the new printer.cfg") : "", h("p", {}, after));
  shown.open = recommended;
  return shown;
}

// The σ after every reading up to each; distances have two ends.
function planOf({ plan }) {
  const place = (end) => end?.slice(0, 2).map((value) => fixed(value, 0)).join(", ") ?? "";
  return table(["", "reading", "x, y (mm)", "to x, y (mm)", "σ in x, y (mm)", "σ in z (mm)"], plan.map(({ reading, ends_mm: [from, to], sigma_mm: [x, y, z] }, k) =>
    [String(k), reading || "as it is", place(from), place(to), Math.hypot(x, y), z]));
}

function residualsOf({ kind, rms_mm: { now, klipper, estimate }, held_out_mm: ways, readings }) {
  const own = kind === "klipper";
  return [
    table(["fit to all readings", "rms (mm)"], [["parameters now", now], [own ? "Klipper's criterion" : "fit without tolerances", klipper], ["estimate with tolerances", estimate]]),
    table(["each reading left out in turn", "heights, rms (mm)", "distances, rms (mm)"], Object.entries(ways).map(([way, of]) => [way, of.heights, of.distances])),
    details(`All ${readings.length} readings`, table(["reading", "now (mm)", own ? "Klipper's (mm)" : "fit (mm)", "estimate (mm)", ""], readings.map((of) =>
      [of.name, of.residual_now_mm, of.residual_klipper_mm, of.residual_mm, of.outlier ? "outlier" : ""])))];
}

// Now and after, to one scale: how far the nozzle is off by the estimate, and the estimate's own σ.
function bedMaps({ points, now, after }) {
  const most = Math.max(0.05, ...points.flatMap((p) => [Math.abs(p[2]), p[4]]));
  const scale = 110 / Math.max(...points.map((p) => p[0])), size = 13; // twelve rings of points
  const map = (title, column, rms) => {
    const label = `${title}; expected error ${fixed(rms[2], 3)} mm rms. Red: up to ${fixed(most, 2)} mm, blue: down to −${fixed(most, 2)} mm`;
    return h("figure", {}, h("svg", { viewBox: "-125 -125 250 250", role: "img", "aria-label": label },
      points.map((p) => h("rect", { x: scale * p[0] - size / 2, y: -scale * p[1] - size / 2, width: size, height: size,
        fill: `hsl(${p[column] < 0 ? 210 : 0} 75% ${97 - 60 * Math.abs(p[column]) / most}%)` },
      h("title", {}, `x ${fixed(p[0], 0)}, y ${fixed(p[1], 0)} mm: off by ${fixed(p[2], 3)} now, σ ${fixed(p[4], 3)} mm`)))),
    h("figcaption", {}, label));
  };
  return h("div", { className: "columns" }, map("Now: height off by the estimate", 2, now.rms_mm), map("After: σ of the height", 4, after.rms_mm));
}
