// The core in WebAssembly, as robots: truepose.h and calibrate.h in wasm32's layout. Units: m, rad.
"use strict";

const MOTORS = 6, READINGS = 16, MODEL_BYTES = 12288;
const LAWS = { joint: 0, tej: 1, estimated: 4 };

const core = {
  // base64: of the module, compressed by gzip.
  async start(base64) {
    const packed = new Blob([Uint8Array.from(atob(base64), (c) => c.charCodeAt(0))]);
    const bytes = await new Response(packed.stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
    // C's standard output, which nothing writes to before it stops: every call fails.
    const none = { fd_write: () => 52, fd_seek: () => 52, fd_close: () => 52 };
    this.c = (await WebAssembly.instantiate(bytes, { wasi_snapshot_preview1: none })).instance.exports;
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
  // Numbers into new memory.
  put(numbers, Kind = Float64Array) {
    const at = this.alloc(Math.max(8, numbers.length * Kind.BYTES_PER_ELEMENT));
    new Kind(this.c.memory.buffer, at, numbers.length).set(numbers);
    return at;
  },
  // f(allocate), after which what it allocated is freed.
  within(f) {
    const taken = [];
    const keep = (at) => (taken.push(at), at);
    try {
      return f((numbers, Kind) => keep(this.put(numbers, Kind)), (count) => keep(this.alloc(8 * count)));
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
    const p = of.parameters.length;
    this.model = core.alloc(MODEL_BYTES);
    core.within((put, room) => {
      const out = room(1), table = put(Uint8Array.from(atob(of.description), (c) => c.charCodeAt(0)), Uint8Array);
      core.c.truepose_load(out, this.model, MODEL_BYTES, table);
      this.check(out);
    });
    // The knowledge: count, -, column, root, sigma.
    this.known = core.alloc(16 + 8 * READINGS);
    const root = new Float64Array(p * p);
    of.root.forEach((row, k) => root.set(row, k * p));
    const arrays = [core.put(of.parameters.map((each) => each.column), Int32Array), core.put(root)];
    core.i32(this.known, 4).set([p, 0, ...arrays]);
    core.f64(this.known + 16, READINGS).fill(0).set(of.sigma);
    this.work = core.alloc(8 * core.c.truepose_work(this.model, p));
  }
  check(out) {
    const [status, part] = core.i32(out, 2);
    if (status > 0) throw new Error(core.why(status) + (part >= 0 ? ` (${part + 1})` : "")); // a chain or reading
  }
  // The same robot with other values of some parameters, [name, value] each.
  with(values) {
    const made = Object.create(Robot.prototype, Object.getOwnPropertyDescriptors(this));
    made.model = core.alloc(MODEL_BYTES);
    const columns = values.map(([name]) => this.of.parameters.find((each) => each.name === name).column);
    core.within((put, room) => {
      const out = room(1);
      core.c.truepose_with_parameters(out, this.model, values.length, put(columns, Int32Array),
        put(values.map(([, value]) => value)), made.model, MODEL_BYTES);
      this.check(out);
    });
    return made;
  }
  free() { core.c.free(this.model); }
  // f(out, input, result) with padded arrays; the first `count` numbers of the result.
  call(f, input, size, count, begin = []) {
    return core.within((put, room) => {
      const out = room(4), result = put(padded(begin, size));
      f(out, put(padded(input, READINGS)), result);
      this.check(out);
      return [...core.f64(result, count)];
    });
  }
  ikm(x) { return this.call((out, at, q) => core.c.truepose_ikm(out, this.model, at, q), x, MOTORS, this.n); }
  fkm(q, near = this.of.home) {
    return this.call((out, at, x) => core.c.truepose_fkm(out, this.model, at, 30, x), q, MOTORS, this.n, near);
  }
  readings(x) {
    return this.call((out, at, q) => core.c.truepose_readings(out, this.model, at, q), x, READINGS, this.width);
  }
  // Position, then rotation by rows.
  frame(x) {
    return this.call((out, at, pose) => core.c.truepose_pose_of(out, this.model, at, pose), x, 12, 12);
  }
  motorError(law, x, readings) {
    return core.within((put) => this.call((out, at, e) => core.c.truepose_motor_error(out, this.model, LAWS[law],
      0, at, put(padded(readings, READINGS)), this.known, this.work, e), x, MOTORS, this.n));
  }
  // Where the true robot stands when the law's motor error is zero: {x, readings}.
  settle(truth, desired, law) {
    const q = this.ikm(desired);
    let x = truth.fkm(q, desired), readings = truth.readings(x);
    for (let step = 0; law !== "joint" && step < 60; ++step) {
      const error = this.motorError(law, desired, readings);
      error.forEach((e, i) => (q[i] += e));
      x = truth.fkm(q, x), readings = truth.readings(x);
      if (Math.max(...error.map(Math.abs)) < 1e-12) break;
    }
    return { x, readings };
  }
  // Identified from rows of readings; NaN: not read.
  calibrate(rows, loss = 0) {
    if (this.width === this.n) throw new Error("no sensor is in use; export the robot with --sensors");
    const p = this.of.parameters.length, { n, width } = this;
    return core.within((put, room) => {
      const log = room(8), fit = room(7), out = room(1), count = rows.length, readings = put(rows.flat());
      const mean = put(this.of.parameters.map((each) => each.mean));
      const arrays = [room(p), room(p * p), room(count * n), 0, room(count)]; // χ² of rows: not asked for
      core.i32(log, 4).set([count, loss, readings, 0]);
      core.i32(fit + 32, 5).set(arrays);
      core.c.truepose_calibrate(out, this.model, this.known, mean, log, fit);
      this.check(out);
      const covariance = core.f64(arrays[1], p * p);
      const value = [...core.f64(arrays[0], p)], x = [...core.f64(arrays[2], count * n)];
      return {
        parameters: this.of.parameters.map((each, k) => (
          { ...each, value: value[k], sigma: Math.sqrt(covariance[k * (p + 1)]), prior: Math.hypot(...this.of.root[k]) })),
        poses: rows.map((_, k) => x.slice(k * n, k * n + n)),
        status: [...core.i32(arrays[4], count)],
        used: core.i32(fit, 4)[3], rms: core.f64(fit + 24, 1)[0],
      };
    });
  }
}

function padded(numbers, size) {
  const all = new Float64Array(size);
  all.set(numbers);
  return all;
}

// Numbers for a given seed (mulberry32), and standard normal ones (Box, Muller).
function generator(seed) {
  const uniform = () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
  const normal = () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform());
  return { uniform, normal };
}
