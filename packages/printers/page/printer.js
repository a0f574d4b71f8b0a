// Calibration of a delta printer: truepose_printer(), text in, JSON out, shown as tables and a map.
"use strict";

// Its answer. Options in mm: arm, probe radius; number of next points; then eight σ, 0: as usual.
function printerAnswer(text, options) {
  const bytes = new TextEncoder().encode(text);
  return core.within((put) => {
    const at = put(bytes, Uint8Array), settings = put(padded(options, 11));
    for (let capacity = 1 << 18; ; ) {
      const json = core.alloc(capacity);
      try {
        const used = core.c.truepose_printer(at, bytes.length, settings, json, capacity);
        if (used <= capacity) return JSON.parse(new TextDecoder().decode(core.bytes(json, used)));
        capacity = used;
      } finally {
        core.c.free(json);
      }
    }
  });
}

const WAYS = { now: "the file's parameters", klipper: "Klipper's criterion", estimate: "estimate with tolerances" };

function printerResult(of, name) {
  if (!of.readings) return [list(of.notes)]; // a configuration without readings
  const outliers = of.readings.filter(({ outlier }) => outlier);
  return [
    h("p", { className: `verdict ${of.rely ? "" : "bad"}` }, of.verdict),
    list(of.words.filter((each) => each !== of.verdict)),
    outliers.length ? h("p", { className: "bad" }, `Outlier: ${outliers.map((each) => each.name).join(", ")}.`) : "",
    list(of.notes),
    h("h3", {}, "Parameters"), parametersOf(of),
    h("h3", {}, "Height of the nozzle over the bed"), bedMaps(of.bed),
    h("h3", {}, "Readings left over"), residualsOf(of),
    linesOf(of, name),
    of.plan.length > 1 ? [h("h3", {}, "What to measure next"), planOf(of)] : "",
    h("details", {}, h("summary", {}, "Assumptions"), list(of.assumptions)),
  ].flat();
}

// What to paste or send; open where the decision recommends it.
function linesOf(of, name) {
  const recommended = of.verdict.startsWith("Use"), text = of.lines.join("\n");
  const title = of.kind === "klipper" ? "Lines for printer.cfg" : "Lines to send";
  return h("details", { open: recommended }, h("summary", {}, recommended ? title : `${title}: not recommended, see the decision above`),
    h("pre", {}, text), h("div", { className: "row" }, copyButton(text),
      of.config ? download(name.replace(/(\.\w+)?$/, "-new.cfg"), of.config, "Save the new printer.cfg") : ""));
}
const list = (lines) => h("ul", {}, lines.map((each) => h("li", {}, each)));

function parametersOf(of) {
  return table(["parameter", "now", "estimate", "σ", "verdict", "Klipper's"], of.parameters.map((each) => {
    const [now, estimate, sigma, klipper] = ["now", "estimate", "sigma", "klipper"].map((key) => fixed(each[key] ?? NaN, key === "sigma" ? 3 : 4));
    const kind = { identified: "good", "not identified": "bad" }[each.verdict];
    return [`${each.name} (${each.unit})`, now, estimate, sigma, { text: each.verdict, kind }, klipper];
  }));
}

// The σ after every reading up to each; distances have two ends.
function planOf({ plan }) {
  const rows = plan.map(({ reading, ends_mm: ends, sigma_mm: [sx, sy, sz] }, k) => [k, reading || "as it is",
    ...[0, 1].flatMap((end) => [0, 1].map((axis) => (ends[end] ? fixed(ends[end][axis], 0) : ""))), fixed(Math.hypot(sx, sy), 3), fixed(sz, 3)]);
  return table(["", "reading", "x (mm)", "y (mm)", "to x (mm)", "to y (mm)", "σ in x, y (mm)", "σ in z (mm)"], rows);
}

function residualsOf(of) {
  const ways = Object.keys(WAYS), kinds = ["heights", "distances"].filter((kind) => of.readings.some(({ distance }) => distance === (kind === "distances")));
  const held = Object.entries(of.held_out_mm).map(([way, at]) => [way, ...kinds.map((kind) => fixed(at[kind] ?? NaN, 3))]);
  return h("div", {},
    h("div", { className: "row" }, table(["fit to all readings", "rms (mm)"], ways.map((way) => [WAYS[way], fixed(of.rms_mm[way], 4)])),
      table(["each reading left out in turn", ...kinds.map((kind) => `${kind}, rms (mm)`)], held)),
    h("details", {}, h("summary", {}, `All ${of.readings.length} readings`),
      table(["reading", "now (mm)", "Klipper's (mm)", "estimate (mm)", ""], of.readings.map((each) => [each.name,
        fixed(each.residual_now_mm, 3), fixed(each.residual_klipper_mm ?? NaN, 3), fixed(each.residual_mm, 3),
        each.outlier ? { text: "outlier", kind: "bad" } : ""]))));
}

// Blue to white to red, by a value from −1 to 1.
function shade(value) {
  const t = Math.max(-1, Math.min(1, value)), fade = (to) => Math.round(245 + Math.abs(t) * (to - 245));
  return `rgb(${(t < 0 ? [33, 102, 172] : [178, 24, 43]).map(fade).join()})`;
}

// Now and after, to one size: how far the nozzle is off by the estimate, and the estimate's own σ.
function bedMaps({ points, now, after }) {
  const all = points.filter((p) => Number.isFinite(p[2])), most = Math.max(0.05, ...all.flatMap((p) => [Math.abs(p[2]), p[4]]));
  const reach = Math.max(...all.map((p) => Math.hypot(p[0], p[1])));
  const gap = Math.min(...all.slice(1).map((p) => Math.hypot(p[0] - all[0][0], p[1] - all[0][1])));
  const scale = 110 / (reach + gap / 2), size = 1.45 * scale * gap;
  const map = (title, column, rms, low) => {
    const label = `${title}; expected error ${fixed(rms[2], 3)} mm rms`;
    return h("figure", {}, svg("svg", { viewBox: "-125 -125 250 250", role: "img", "aria-label": label },
      all.map((p) => svg("rect", { x: scale * p[0] - size / 2, y: -scale * p[1] - size / 2,
        width: size, height: size, fill: shade(p[column] / most) },
      svg("title", {}, `x ${fixed(p[0], 0)}, y ${fixed(p[1], 0)} mm: off by ${fixed(p[2], 3)} now, σ ${fixed(p[4], 3)} mm`)))),
    legend(low, most), h("figcaption", {}, label));
  };
  return h("div", { className: "maps" }, map("Now: height off by the estimate", 2, now.rms_mm, -1),
    map("After: σ of the height", 4, after.rms_mm, 0));
}

// Colours from low, −1 or 0, to 1 times the largest value, mm.
function legend(low, most) {
  return svg("svg", { class: "legend", viewBox: "0 0 260 30", role: "img", "aria-label": `scale from ${fixed(low * most, 2)} to ${fixed(most, 2)} mm` },
    Array.from({ length: 52 }, (_, k) => svg("rect", { x: 5 * k, y: 0, width: 5.5, height: 12, fill: shade(low + ((1 - low) * (k + 0.5)) / 52) })),
    [[low, 0, "start"], [(low + 1) / 2, 130, "middle"], [1, 260, "end"]].map(([at, x, anchor]) =>
      svg("text", { x, y: 27, "text-anchor": anchor }, `${at > 0 && low < 0 ? "+" : ""}${fixed(at * most, 2)} mm`)));
}
