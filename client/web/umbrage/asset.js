// SPDX-License-Identifier: Apache-2.0
// An asset of which some pages are held: fetching what a view needs, and queries.
import { UmbrageError, require } from "./errors.js";
import { placementOf, takeChanges } from "./gpu_data.js";
import { heldOf, openFront, update } from "./rounds.js";
import { Module } from "./module.js";

const SLICE = 32_768; // Points that are answered at a time
const TURN_MS = 8; // A query of many points lets other work of the page in after this time
const KINDS = ["directional", "spot", "point", "rectangle", "disc"];
// Members of the result of explain(), in the order of umbx_explain, with the count of numbers of
// each; 0: a boolean.
const EXPLAINED = { answer: 1, lit_taps: 1, taps: 1, level: 1, frustum: 1, nodes: 1, bricks: 1, transmittance: 1, bias_m: 1,
  cosine: 1, voxel_size_m: 1, footprint_m: 1, facing_away: 0, undefined: 0, outside: 0, before: 0, behind: 0, has_normal: 0,
  moved: 3, voxel: 3, cell: 3, window: 2, step_count: 1, rows: 17, steps: 48 };
const STATES = ["shadowed", "lit", "mixed"];
const OWN = new Set(["normal", "normals", "footprints", "origin", "bias", "bias_unit", "light", "want", "bounds"]);
const MEMORY = 256 << 20;

/** Ends the turn of this query, so that other events are handled. */
function pause() {
  if (typeof setImmediate === "function") {
    return new Promise((resolve) => setImmediate(resolve));
  }
  return new Promise((resolve) => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => {
      port1.close();
      resolve();
    };
    port2.postMessage(null);
  });
}

function triple(value, name) {
  require(value?.length === 3 && Array.prototype.every.call(value, Number.isFinite), `${name}: must be three finite numbers`);
  return Array.from(value);
}

function number(value, name) {
  require(typeof value === "number" && Number.isFinite(value), `${name}: ${String(value).slice(0, 40)}, must be a finite number`);
  return value;
}

function whole(value, name) {
  require(Number.isInteger(value) && value >= 0, `${name}: ${String(value).slice(0, 40)}, must be a whole number`);
  return value;
}

function idBytes(id) {
  if (id === undefined || id === null) {
    return null;
  }
  require(typeof id === "string" && /^[0-9a-f]{64}$/i.test(id), "id: must be 64 hexadecimal digits");
  return Uint8Array.from(id.match(/../g), (pair) => parseInt(pair, 16));
}

/** Places of a slice of points and of its answers in the module's memory. */
class Scratch {
  constructor(module) {
    const bytes = { positions: 24, normals: 12, footprints: 4, values: 4, room: 16 };
    for (const [name, each] of Object.entries(bytes)) {
      this[name] = module.room(each * SLICE);
    }
  }
}

export class Asset {
  #module;
  #source;
  #scratch = null;
  #turn = Promise.resolve(); // The last `want`: they run one after the other
  #stops = new Set(); // Of every `want` under way
  #counts = { received_bytes: 0, requests: 0, rounds: 0, pages_received: 0 };

  /** Id, lights, origin and box of the casters; whatever pages are held. */
  info;

  static async open(source, { id, memory = MEMORY, signal, wasm } = {}) {
    const asset = new Asset(), wanted = idBytes(id);
    require(Number.isSafeInteger(memory) && memory > 0, `memory: ${memory}, must be a number of bytes above 0`);
    try {
      asset.#module = await Module.make(wasm);
      asset.#source = source;
      await openFront(asset.#module, source, { id: wanted, memory, signal }, asset.#counts);
      asset.info = asset.#readInfo();
    } catch (error) {
      await source.close?.();
      throw error;
    }
    return asset;
  }

  #readInfo() {
    const module = this.#module, lights = [];
    const id = Array.from(module.bytes(module.call("id"), 32), (byte) => byte.toString(16).padStart(2, "0")).join("");
    module.call("info");
    const [light_count, , ...places] = module.numbers(11);
    for (let index = 0; index < light_count; index++) {
      const name = module.text(module.call("light", index)), numbers = Array.from(module.numbers(10));
      lights.push({ name, kind: KINDS[numbers[0]] ?? "unknown", direction: numbers.slice(1, 4),
        position: numbers.slice(4, 7), extent: numbers[7], voxels: numbers[8], frusta: numbers[9] });
    }
    return { id, lights, origin: places.slice(0, 3), bounds: [places.slice(3, 6), places.slice(6, 9)] };
  }

  #opened() {
    if (this.#module === null) {
      throw new UmbrageError("E_STATE", "asset: is closed");
    }
    return this.#module;
  }

  #lightNumber(light) {
    if (typeof light !== "string") {
      return light;
    }
    const found = this.info.lights.findIndex((one) => one.name === light);
    if (found < 0) {
      throw new UmbrageError("E_NOT_FOUND", `light: there is none of the name ${light.slice(0, 64)}`);
    }
    return found;
  }

  /** Tells the module what one view needs. */
  #mark(view, add) {
    require(typeof view === "object" && view !== null, "view: must be an object");
    const { light, box, camera, max_error_m = 0, max_error_rad = 0, taps = 0, bias_m = 0 } = view;
    const numbers = new Float64Array(25);
    numbers[0] = light === undefined || light === null ? -1 : whole(this.#lightNumber(light), "light");
    if (box) {
      numbers.set([1, ...triple(box[0], "box[0]"), ...triple(box[1], "box[1]")], 1);
    }
    if (camera) {
      const eye = triple(camera.eye, "eye"), up = triple(camera.up ?? [0, 1, 0], "up");
      const forward = camera.target
        ? triple(camera.target, "target").map((one, axis) => one - eye[axis])
        : triple(camera.forward, "forward");
      numbers.set([1, ...eye, ...forward, ...up, number(camera.fov_y, "fov_y"), number(camera.aspect ?? 1, "aspect"),
        number(camera.far_m ?? 0, "far_m")], 8);
    }
    numbers.set([number(max_error_m, "max_error_m"), number(max_error_rad, "max_error_rad"), whole(taps, "taps"),
      number(bias_m, "bias_m")], 21);
    this.#opened().numbers(25).set(numbers);
    this.#module.run("want", add ? 1 : 0);
  }

  async want(views = [], { max_bytes = 0, round_bytes = 0, signal, progress } = {}) {
    const list = Array.isArray(views) ? views : [views], before = this.#turn, stop = new AbortController();
    const mark = () => list.forEach((view, index) => this.#mark(view, index > 0));
    const pass = () => stop.abort(signal.reason);
    let release;
    this.#turn = new Promise((resolve) => {
      release = resolve;
    });
    this.#stops.add(stop);
    signal?.addEventListener("abort", pass);
    try {
      signal?.throwIfAborted();
      await before;
      await update(this.#opened(), this.#source, mark, { max_bytes, round_bytes, signal: stop.signal, progress },
        this.#counts);
      return this.held();
    } finally {
      signal?.removeEventListener("abort", pass);
      this.#stops.delete(stop);
      release();
    }
  }

  held() {
    const counts = { ...this.#counts }; // A source may have received more than it was asked for
    counts.received_bytes = this.#source?.received_bytes ?? counts.received_bytes;
    return { ...heldOf(this.#opened(), counts), module_bytes: this.#module.memoryBytes };
  }

  /** Returns the entries for a GPU that changed since the last call: see gpu.js. */
  changes() {
    return takeChanges(this.#opened());
  }

  /** Returns the transform from a shader's positions to the voxels of a light. */
  placement({ light = 0, face = 0, origin = [0, 0, 0], to_world, bias = "auto", bias_unit = "metres" } = {}) {
    require(to_world === undefined || to_world?.length === 16, "to_world: must be 16 numbers, column major");
    require(typeof bias === "number" || bias === "auto" || bias === "none", "bias: must be auto, none or a number");
    const mode = typeof bias === "string" ? bias : bias_unit;
    return placementOf(this.#opened(), whole(this.#lightNumber(light), "light"), whole(face, "face"), triple(origin, "origin"),
      to_world && Array.from(to_world), mode, typeof bias === "string" ? 0 : number(bias, "bias"));
  }

  /** Gives the module the settings of a query. */
  #prepare(options) {
    const module = this.#opened(), { bias = "auto", bias_unit = "metres", light = 0 } = options;
    module.call("settings_clear");
    module.set("light", this.#lightNumber(light));
    if (typeof bias === "string") {
      module.set("bias_mode", bias);
    } else {
      module.set("bias_mode", bias_unit);
      module.set("bias", bias);
    }
    for (const [name, value] of Object.entries(options)) {
      if (!OWN.has(name) && value !== undefined) {
        module.set(name, typeof value === "boolean" ? Number(value) : value);
      }
    }
  }

  async query(points, options = {}) {
    const batch = new Batch(points, options), answers = new Answers(batch.count, options);
    let since = performance.now();
    for (let first = 0; first === 0 || first < batch.count; first += SLICE) {
      if (performance.now() - since > TURN_MS) {
        await pause();
        since = performance.now();
      }
      this.#answer(batch, answers, first, Math.min(SLICE, batch.count - first), options);
    }
    return answers.finish();
  }

  /** Answers one slice. Nothing else runs meanwhile, so settings and memory are this slice's. */
  #answer(batch, answers, first, count, options) {
    const module = this.#opened();
    this.#scratch ??= new Scratch(module);
    this.#prepare(options);
    const places = batch.copyIn(module, this.#scratch, first, count);
    module.numbers(3).set(batch.origin);
    try {
      module.run("query", this.#scratch.positions, batch.isWide ? 1 : 0, count, places.normals, places.footprints,
        options.want === false ? 0 : 1, this.#scratch.values, this.#scratch.room);
    } catch (error) {
      // The module sees a slice: it counts from the slice's first point.
      error.message = error.message.replace(/^(points|footprints)\[(\d+)\]/, (_, name, index) =>
        `${name}[${first + Number(index)}]`);
      throw error;
    }
    answers.copyOut(module, this.#scratch, first, count);
  }

  explain(point, options = {}) {
    const module = this.#opened(), [x, y, z] = triple(point, "point"), { normal } = options;
    this.#prepare(options);
    module.numbers(3).set(normal === undefined ? [0, 0, 0] : triple(normal, "normal"));
    module.run("explain", x, y, z, normal === undefined ? 0 : 1);
    const numbers = Array.from(module.numbers(96)), explanation = {};
    let at = 0;
    for (const [name, count] of Object.entries(EXPLAINED)) {
      const some = numbers.slice(at, at += count || 1);
      explanation[name] = count === 0 ? some[0] !== 0 : count === 1 ? some[0] : some;
    }
    const { step_count, steps, ...rest } = explanation;
    return { ...rest, rows: rest.rows.slice(0, rest.taps), steps: Array.from({ length: Math.min(step_count, 16) },
      (_, i) => ({ level: steps[3 * i], state: STATES[steps[3 * i + 1]], index: steps[3 * i + 2] })) };
  }

  async close() {
    const source = this.#source;
    this.#module = null;
    this.#source = null;
    for (const stop of this.#stops) {
      stop.abort(new UmbrageError("E_STATE", "asset: was closed"));
    }
    await this.#turn;
    await source?.close?.();
  }
}

/** Points of a query, checked. */
class Batch {
  constructor(points, { normals, footprints, origin = [0, 0, 0] }) {
    this.isWide = points instanceof Float64Array;
    require(this.isWide || points instanceof Float32Array, "points: must be a Float32Array or a Float64Array");
    require(points.length % 3 === 0, `points: ${points.length} numbers, must be three a point`);
    this.count = points.length / 3;
    require(normals === undefined || (normals instanceof Float32Array && normals.length === points.length),
      `normals: must be a Float32Array of ${points.length} numbers`);
    require(footprints === undefined || (footprints instanceof Float32Array && footprints.length === this.count),
      `footprints: must be a Float32Array of ${this.count} numbers`);
    this.origin = triple(origin, "origin");
    Object.assign(this, { points, normals, footprints });
  }

  copyIn(module, scratch, first, count) {
    const copy = (array, at, each) => {
      if (!array) {
        return 0;
      }
      const size = array.BYTES_PER_ELEMENT * each;
      module.bytes(at, size * count).set(new Uint8Array(array.buffer, array.byteOffset + size * first, size * count));
      return at;
    };
    copy(this.points, scratch.positions, 3);
    return { normals: copy(this.normals, scratch.normals, 3), footprints: copy(this.footprints, scratch.footprints, 1) };
  }
}

const FORMATS = {
  f32: { make: (count) => new Float32Array(count), bytes: (count) => 4 * count },
  u8: { make: (count) => new Uint8Array(count), bytes: (count) => count },
  bit: { make: (count) => new Uint8Array(Math.ceil(count / 8)), bytes: (count) => Math.ceil(count / 8) },
};
const COUNTS = ["points", "outside", "before", "behind", "facing_away", "undefined", "nodes", "bricks"];

/** Answers of a query, collected slice by slice. */
class Answers {
  constructor(count, { format = "f32", bounds = false }) {
    require(Object.hasOwn(FORMATS, format), `format: ${String(format).slice(0, 40)}, must be one of f32, u8, bit`);
    this.format = FORMATS[format];
    this.result = { values: this.format.make(count), exact: new Uint8Array(count), bound: 0, exact_count: 0,
      worst_error_m: 0, stats: Object.fromEntries(COUNTS.map((name) => [name, 0])) };
    if (bounds) {
      require(format === "f32", "bounds: are given of format f32 only");
      Object.assign(this.result, { low: new Float32Array(count), high: new Float32Array(count),
        error_m: new Float32Array(count) });
    }
  }

  copyOut(module, scratch, first, count) {
    const { result, format } = this, [exact, worst, bound, ...counts] = module.numbers(11);
    const bytes = new Uint8Array(result.values.buffer);
    bytes.set(module.bytes(scratch.values, format.bytes(count)), format.bytes(first));
    const all = module.floats(scratch.room, 3 * count);
    const low = all.subarray(0, count), high = all.subarray(count, 2 * count), end = first + count;
    if (exact === count) {
      result.exact.fill(1, first, end);
      result.low?.set(result.values.subarray(first, end), first);
      result.high?.set(result.values.subarray(first, end), first);
    } else {
      for (let i = 0; i < count; i++) {
        result.exact[first + i] = low[i] === high[i] ? 1 : 0;
      }
      result.low?.set(low, first);
      result.high?.set(high, first);
      result.error_m?.set(all.subarray(2 * count), first);
    }
    result.exact_count += exact;
    result.bound = bound;
    result.worst_error_m = Math.max(result.worst_error_m, worst);
    COUNTS.forEach((name, index) => {
      result.stats[name] += counts[index];
    });
  }

  finish() {
    return this.result;
  }
}
