// The core in WebAssembly, as robots: truepose.h and calibrate.h in wasm32's layout. Units: m, rad.
"use strict";

const MOTORS = 8, READINGS = 20, MODEL_BYTES = 12288, CYCLE_NUMBERS = 512;
const LAWS = { joint: 0, tej: 1, estimated: 4 };
const binary = (base64) => Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));

const core = {
  // base64: of the module, compressed by gzip.
  async start(base64) {
    const bytes = new Blob([binary(base64)]).stream().pipeThrough(new DecompressionStream("gzip"));
    // C's standard output, which nothing writes to before it stops: every call fails.
    const none = { fd_write: () => 52, fd_seek: () => 52, fd_close: () => 52 };
    this.c = (await WebAssembly.instantiate(await new Response(bytes).arrayBuffer(), { wasi_snapshot_preview1: none })).instance.exports;
    this.c.__wasm_call_ctors();
  },
  // Views are made anew: memory that grows leaves earlier ones empty.
  f64(at, count) { return new Float64Array(this.c.memory.buffer, at, count); },
  i32(at, count) { return new Int32Array(this.c.memory.buffer, at, count); },
  bytes(at, count) { return new Uint8Array(this.c.memory.buffer, at, count); },
  alloc(bytes) {
    const at = this.c.malloc(bytes);
    if (!at) throw new Error(`${bytes} bytes of memory are not available`);
    return at;
  },
  // Numbers into new memory, zeros behind few: f64, or as in a typed array.
  put(numbers) {
    const from = Array.isArray(numbers) ? Float64Array.from(numbers) : numbers;
    const size = Math.max(8 * READINGS, from.byteLength), at = this.alloc(size);
    this.bytes(at, size).fill(0);
    new from.constructor(this.c.memory.buffer, at, from.length).set(from);
    return at;
  },
  // f(put, room), after which what these allocated is freed.
  within(f) {
    const taken = [], keep = (at) => (taken.push(at), at);
    try {
      return f((numbers) => keep(this.put(numbers)), (count) => keep(this.alloc(8 * count)));
    } finally {
      taken.forEach((at) => this.c.free(at));
    }
  },
  why(status) {
    const all = new Uint8Array(this.c.memory.buffer, this.c.truepose_status_text(status));
    return new TextDecoder().decode(all.slice(0, all.indexOf(0)));
  },
};

class Robot {
  // of: what `truepose export json` wrote.
  constructor(of) {
    if (!/robot for a browser/.test(of?.format)) throw new Error("this JSON is not of `truepose export json`");
    this.of = of;
    this.n = of.coordinates.length;
    this.width = of.readings.length;
    const p = of.parameters.length, root = new Float64Array(p * p);
    this.model = core.alloc(MODEL_BYTES);
    this.call("load", 0, MODEL_BYTES, binary(of.description));
    of.root.forEach((row, k) => root.set(row, k * p));
    // The knowledge: count, column, root, -, sigma.
    this.known = core.put([0, 0, ...of.sigma, ...Array(READINGS - of.sigma.length).fill(0)]);
    const arrays = [core.put(Int32Array.from(of.parameters, ({ column }) => column)), core.put(root)];
    core.i32(this.known, 3).set([p, ...arrays]);
    this.work = core.alloc(8 * core.c.truepose_work(this.model, p));
  }
  // A function of the core: numbers as they are, arrays in memory; the first `count` numbers of the last one.
  call(name, count, ...inputs) {
    return core.within((put, room) => {
      const out = room(4), given = inputs.map((each) => (typeof each === "number" ? each : put(each)));
      core.c[`truepose_${name}`](out, this.model, ...given);
      const [status, part] = core.i32(out, 2);
      if (status > 0) throw new Error(core.why(status) + (part >= 0 ? ` (${part + 1})` : "")); // a chain or reading
      return [...core.f64(given.at(-1), count)];
    });
  }
  // The same robot with other values of some parameters, [name, value] each.
  with(values) {
    const made = Object.create(Robot.prototype, Object.getOwnPropertyDescriptors(this));
    made.model = core.alloc(MODEL_BYTES);
    const columns = values.map(([name]) => this.of.parameters.find((each) => each.name === name).column);
    this.call("with_parameters", 0, values.length, Int32Array.from(columns), values.map(([, value]) => value), made.model, MODEL_BYTES);
    return made;
  }
  free() { core.c.free(this.model); }
  ikm(x) { return this.call("ikm", this.n, x, []); }
  fkm(q, near) { return this.call("fkm", this.n, q, 30, near); }
  readings(x) { return this.call("readings", this.width, x, []); }
  // Position, then rotation by rows.
  frame(x) { return this.call("pose_of", 12, x, []); }
  // Where the true robot stands when the law's motor error is zero: {x, readings}.
  settle(truth, desired, law) {
    const q = this.ikm(desired);
    let x = truth.fkm(q, desired), readings = truth.readings(x);
    for (let step = 0; law !== "joint" && step < 60; ++step) {
      const cycle = this.call("servo", MOTORS + this.n, LAWS[law], 0, desired, readings, this.known, this.work, Array(CYCLE_NUMBERS).fill(0));
      const error = cycle.slice(MOTORS); // behind q_d
      error.forEach((e, i) => (q[i] += e));
      x = truth.fkm(q, x), readings = truth.readings(x);
      if (Math.max(...error.map(Math.abs)) < 1e-12) break;
    }
    return { x, readings };
  }
  // Identified from rows of readings; NaN: not read.
  calibrate(rows) {
    if (this.width === this.n) throw new Error("no sensor is in use; export the robot with --sensors");
    const { parameters, root } = this.of, p = parameters.length, count = rows.length;
    return core.within((put, room) => {
      const log = room(8), fit = room(7), readings = put(rows.flat()), arrays = [p, p * p, count * this.n, 0, count].map((size) => size && room(size));
      core.i32(log, 4).set([count, 0, readings, 0]);
      core.i32(fit + 32, 5).set(arrays); // χ² of rows: not asked for
      this.call("calibrate", 0, this.known, parameters.map(({ mean }) => mean), log, fit);
      const [value, covariance, x] = [p, p * p, count * this.n].map((size, k) => [...core.f64(arrays[k], size)]);
      return {
        parameters: parameters.map((each, k) => (
          { ...each, value: value[k], sigma: Math.sqrt(covariance[k * (p + 1)]), prior: Math.hypot(...root[k]) })),
        poses: rows.map((_, k) => x.slice(k * this.n, (k + 1) * this.n)),
        status: [...core.i32(arrays[4], count)],
        used: core.i32(fit, 4)[3], rms: core.f64(fit + 24, 1)[0],
      };
    });
  }
}

// Numbers for a given seed: uniform ones, and standard normal ones (Box, Muller).
function generator(seed) {
  const uniform = () => (seed = (1664525 * seed + 1013904223) % 2 ** 32) / 2 ** 32;
  const normal = () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform());
  return { uniform, normal };
}
