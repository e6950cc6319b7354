// SPDX-License-Identifier: Apache-2.0
// Checks of the package `umbrage` that run alike in node, in a page and in a worker.
//
//     const checks = await run(umbrage, config, read);   // [{ name, ok, detail }]
//
// config: tests/system/test_web.py writes it. read(name) gives a file's bytes; where(name) an asset's address.

const STALLED_S = 20; // A file that takes longer hangs a tab

function assert(holds, message) {
  if (!holds) {
    throw new Error(message);
  }
}

function same(a, b) {
  return a.length === b.length && a.every((one, index) => one === b[index]);
}

/** Points x y z nx ny nz ... as positions and normals. */
function separate(numbers) {
  const count = numbers.length / 6, positions = new Float32Array(3 * count), normals = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) {
    positions.set(numbers.subarray(6 * i, 6 * i + 3), 3 * i);
    normals.set(numbers.subarray(6 * i + 3, 6 * i + 6), 3 * i);
  }
  return { positions, normals };
}

async function pointsOf(one, read) {
  const bytes = await read(one.points);
  if (one.wide) {
    return { positions: new Float64Array(bytes) };
  }
  return one.normals ? separate(new Float32Array(bytes)) : { positions: new Float32Array(bytes) };
}

/** Fails unless the promise is rejected with the code and words of the message. */
async function refused(promise, code, words) {
  try {
    await promise;
  } catch (error) {
    assert(error.code === code && error.message.includes(words), `${error.code} ${error.message}, not ${code} ${words}`);
    return;
  }
  throw new Error(`nothing was refused, not even ${code} ${words}`);
}

/** Answers of the whole asset have the bits of `umbrage query`. */
async function bits(umbrage, one, read, where) {
  const { positions, normals } = await pointsOf(one, read);
  const asset = await umbrage.open(where(one.asset));
  await asset.want({});
  const begin = performance.now();
  const { values, exact_count, exact } = await asset.query(positions, { ...one.settings, normals });
  const took = performance.now() - begin, count = positions.length / 3;
  const expected = new Uint8Array(await read(one.expected)), got = new Uint8Array(values.buffer);
  let wrong = expected.length === got.length ? 0 : -1;
  for (let i = 0; i < expected.length && wrong >= 0; i++) {
    wrong += expected[i] === got[i] ? 0 : 1;
  }
  await asset.close();
  assert(wrong === 0, `${wrong} bytes of ${expected.length} differ, ${got.length} came`);
  assert(exact_count === count && exact.every((each) => each === 1), `${exact_count} of ${count} are exact`);
  return `${count} points, ${(took * 1e6 / count).toFixed(1)} ns each`;
}

/** With some pages held, exact answers are the file's, and the others lie within their bounds. */
async function bounds(umbrage, one, config, read, where) {
  const { positions, normals } = await pointsOf(one, read);
  const expected = new Float32Array(await read(one.expected));
  const asset = await umbrage.open(where(one.asset), { id: config.ids[one.asset] });
  const steps = [];
  const look = async () => {
    const answers = await asset.query(positions, { ...one.settings, normals, bounds: true, want: false });
    for (let i = 0; i < expected.length; i++) {
      const { values, low, high, exact, error_m } = answers;
      assert(low[i] <= values[i] && values[i] <= high[i], `point ${i}: ${values[i]} is not within its bounds`);
      assert(low[i] <= expected[i] && expected[i] <= high[i], `point ${i}: the truth is not within its bounds`);
      assert((exact[i] === 1) === (low[i] === high[i]), `point ${i}: exact ${exact[i]}`);
      assert((error_m[i] > 0) === (exact[i] === 0), `point ${i}: error_m ${error_m[i]}`);
    }
    steps.push(answers.exact_count);
    return answers;
  };
  const first = await look();
  for (const format of ["u8", "bit"]) {
    const packed = await asset.query(positions, { ...one.settings, normals, format, want: false });
    for (let i = 0; i < expected.length; i++) {
      const value = format === "u8" ? packed.values[i] : packed.values[i >> 3] >> (i & 7) & 1;
      const float = Math.fround(first.values[i]);
      const wanted = format === "u8" ? Math.floor(Math.fround(Math.fround(float * 255) + 0.5)) : float >= 0.5 ? 1 : 0;
      assert(Math.abs(value - wanted) <= (format === "u8" && first.exact[i] ? 1 : 0), `${format} of point ${i}`);
    }
  }
  await asset.want({ camera: one.camera, taps: one.settings.taps }, { round_bytes: 32768, progress: () => steps.length > 4 });
  await look();
  // Pages that inexact points need, and nothing else.
  for (let turn = 0; turn < 20 && (await asset.query(positions, { ...one.settings, normals })).exact_count < expected.length; turn++) {
    await asset.want();
  }
  const last = await look(), held = asset.held();
  assert(last.exact_count === expected.length, `${last.exact_count} of ${expected.length} are exact in the end`);
  assert(held.pages_held < held.pages && held.received_bytes < held.asset_bytes, "all pages are here");
  assert(same(last.values, expected), "the exact answers are not the file's");
  await asset.close();
  return `exact: ${steps.join(", ")} of ${expected.length}; ${held.received_bytes} of ${held.asset_bytes} bytes`;
}

/** The budget drops pages; answers keep their bounds. */
async function budget(umbrage, one, read, where) {
  const { positions, normals } = await pointsOf(one, read);
  const expected = new Float32Array(await read(one.expected));
  const asset = await umbrage.open(where(one.asset), { memory: one.memory });
  await asset.want({});
  const held = asset.held();
  assert(held.memory_peak_bytes <= one.memory, `${held.memory_peak_bytes} bytes, the budget is ${one.memory}`);
  assert(held.pages_held < held.pages, "all pages fit");
  const { low, high } = await asset.query(positions, { ...one.settings, normals, bounds: true });
  assert(expected.every((value, i) => low[i] <= value && value <= high[i]), "an answer is not within its bounds");
  await asset.close();
  return `${held.pages_held} of ${held.pages} pages within ${one.memory} bytes, module ${held.module_bytes}`;
}

/** Each mistake has a code and the sentence of the C side. */
async function mistakes(umbrage, one, where) {
  const asset = await umbrage.open(where(one.asset)), points = new Float32Array(3 * 40000);
  const ask = (settings) => asset.query(points, settings);
  await refused(ask({ taps: 4 }), "E_ARGUMENT", "taps: 4, must be odd and at most 17");
  await refused(ask({ taps: 1.5 }), "E_ARGUMENT", "taps: 1.5, must be a whole number");
  await refused(ask({ tap: 4 }), "E_ARGUMENT", "tap: there is no such setting");
  await refused(ask({ filter: "cone" }), "E_ARGUMENT", "filter: cone, must be one of box|tent");
  await refused(ask({ filter: 99 }), "E_ARGUMENT", "filter: 99");
  await refused(ask({ format: "f64" }), "E_ARGUMENT", "format: f64, must be one of");
  await refused(ask({ light: 99 }), "E_NOT_FOUND", "light");
  await refused(ask({ light: "moon" }), "E_NOT_FOUND", "moon");
  await refused(ask({ bias: NaN }), "E_ARGUMENT", "bias");
  await refused(ask({ normals: new Float32Array(3) }), "E_ARGUMENT", "normals");
  await refused(asset.query([1, 2, 3]), "E_ARGUMENT", "points: must be a Float32Array");
  await refused(asset.query(new Float32Array(4)), "E_ARGUMENT", "three a point");
  await refused(ask({ origin: [0, 0, Infinity] }), "E_ARGUMENT", "origin");
  points[3 * 39000 + 1] = NaN;
  await refused(ask({}), "E_ARGUMENT", "points[39000].y: nan, must be finite");
  await refused(asset.want({ box: [[0, 0, 0], [-1, 0, 0]] }), "E_ARGUMENT", "box");
  await refused(asset.want({ light: 0.5 }), "E_ARGUMENT", "light: 0.5, must be a whole number");
  await refused(asset.want({ taps: 19 }), "E_ARGUMENT", "taps");
  await refused(asset.want({ light: 7 }), "E_ARGUMENT", "light");
  await refused(asset.want({ camera: { eye: [0, 0, 0], forward: [0, 0, 0], fov_y: 1 } }), "E_ARGUMENT", "forward");
  await refused(umbrage.open(where(one.asset), { id: "0".repeat(64) }), "E_CORRUPT", "id: the head is that of another");
  await refused(umbrage.open(where(one.asset), { id: "12" }), "E_ARGUMENT", "id: must be 64");
  await refused(umbrage.open(where(one.asset), { memory: 1000 }), "E_TOO_LARGE", "budget");
  await refused(umbrage.open(new Uint8Array(500)), "E_FORMAT", "");
  await refused(umbrage.open(new Uint8Array(0)), "E_FORMAT", "");
  assert((await asset.query(new Float32Array(0))).values.length === 0, "no points, no answers");
  await asset.close();
  await refused(ask({}), "E_STATE", "closed");
}

/** Calls overlap: queries are answered from the pages of the moment, with the settings of their own. */
async function overlaps(umbrage, one, read, where) {
  const { positions, normals } = await pointsOf(one, read);
  const asset = await umbrage.open(where(one.asset));
  const stop = new AbortController();
  const all = [asset.want({}, { round_bytes: 65536 }), asset.want({ camera: one.camera }),
    ...[1, 3, 9].map((taps) => asset.query(positions, { taps, normals }))];
  const answers = (await Promise.all(all)).slice(2);
  for (const [index, taps] of [1, 3, 9].entries()) {
    const again = await asset.query(positions, { taps, normals });
    assert(answers[index].exact.every((exact, i) => !exact || answers[index].values[i] === again.values[i]), `${taps} taps`);
  }
  stop.abort();
  const other = await umbrage.open(where(one.asset));
  let name = "";
  await other.want({}, { signal: stop.signal }).catch((error) => {
    name = error.name;
  });
  assert(name === "AbortError", `an aborted want: ${name}`);
  await other.want({});
  await Promise.all([asset.close(), other.close()]);
  const closed = await umbrage.open(where(one.asset)), waits = closed.want({}, { round_bytes: 65536 });
  const ended = refused(waits, "E_STATE", "closed"), late = refused(closed.want({}), "E_STATE", "closed");
  await closed.close();
  await Promise.all([ended, late]);
}

/** A small generator of random numbers, 0 to below `most`. */
function generator(seed) {
  let state = seed >>> 0;
  return (most) => {
    state = Math.imul(state ^ state >>> 15, 0x2c1b3c6d) + 0x9e3779b9 >>> 0;
    let x = state;
    x = Math.imul(x ^ x >>> 16, 0x85ebca6b);
    x = Math.imul(x ^ x >>> 13, 0xc2b2ae35);
    return ((x ^ x >>> 16) >>> 0) % most;
  };
}

/** A file with a few bytes changed, cut off, doubled or moved. */
function mutate(file, random) {
  let bytes = file.slice();
  for (let changes = 1 + random(4); changes > 0; changes--) {
    const at = random(random(2) ? Math.min(bytes.length, 4096) : bytes.length), kind = random(5);
    if (kind === 0 && random(4) === 0) {
      bytes = bytes.slice(0, at + 1);
    } else if (kind === 1) {
      bytes.copyWithin(at, random(bytes.length), random(bytes.length));
    } else if (kind === 2) {
      bytes.fill(random(2) * 255, at, at + random(64));
    } else {
      bytes[at] ^= 1 << random(8);
    }
  }
  return bytes;
}

/** Opens a file, fetches all of it and asks. Returns "answered", or the code of the refusal. */
async function ordeal(umbrage, file, points) {
  const begin = performance.now();
  let outcome = "answered";
  try {
    const asset = await umbrage.open(file, { memory: 64 << 20 });
    try {
      await asset.want({ camera: { eye: [0, 2, 0], forward: [1, 0, 0.1], fov_y: 1 } });
      await asset.want({});
      const { low, values, high } = await asset.query(points, { taps: 9, bounds: true });
      assert(values.every((value, i) => low[i] <= value && value <= high[i]), "an answer is not within its bounds");
    } finally {
      await asset.close();
    }
  } catch (error) {
    outcome = error.code;
    assert(/^E_/.test(outcome) && outcome !== "E_INTERNAL", `${error}: no refusal\n${error.stack}`);
  }
  const seconds = (performance.now() - begin) / 1000;
  assert(seconds < STALLED_S, `${outcome} after ${seconds} s`);
  return outcome;
}

/** Changed files, and files that are sealed around changed pages, are answered or refused in bounded time. */
async function hostile(umbrage, one, read) {
  const file = new Uint8Array(await read(one.asset)), random = generator(one.seed), outcomes = {};
  const points = Float32Array.from({ length: 600 }, () => random(2000) / 10 - 100);
  for (let round = 0; round < one.rounds; round++) {
    const outcome = await ordeal(umbrage, mutate(file, random), points);
    outcomes[outcome] = (outcomes[outcome] ?? 0) + 1;
  }
  for (const name of one.sealed ?? []) {
    const outcome = await ordeal(umbrage, new Uint8Array(await read(name)), points);
    outcomes[outcome] = (outcomes[outcome] ?? 0) + 1;
  }
  return JSON.stringify(outcomes);
}

/** A page that does not hash to what the directory says is refused by its number; the others stay. */
async function false_page(umbrage, one, read) {
  const asset = await umbrage.open(new Uint8Array(await read(one.forged)));
  await refused(asset.want({}), "E_CORRUPT", `page ${one.page} of the file`);
  await asset.query(new Float32Array(3));
  await asset.close();
}

export async function run(umbrage, config, read, where = (name) => name) {
  const checks = [];
  const check = async (name, work) => {
    try {
      const detail = await work();
      checks.push({ name, ok: true, detail: detail ?? "" });
    } catch (error) {
      checks.push({ name, ok: false, detail: `${error.code ?? ""} ${error.stack ?? error}` });
    }
  };
  for (const one of config.bits ?? []) {
    await check(`${one.asset}: ${JSON.stringify(one.settings)} has the bits of the native answers`,
      () => bits(umbrage, one, read, where));
  }
  for (const one of config.bounds ?? []) {
    await check(`${one.asset}: bounds hold while pages arrive`, () => bounds(umbrage, one, config, read, where));
    await check(`${one.asset}: calls overlap`, () => overlaps(umbrage, one, read, where));
  }
  for (const one of config.budgets ?? []) {
    await check(`${one.asset}: a small budget drops pages`, () => budget(umbrage, one, read, where));
  }
  for (const one of config.mistakes ?? []) {
    await check("mistakes are named", () => mistakes(umbrage, one, where));
  }
  for (const one of config.forged ?? []) {
    await check("a false page is refused by its number", () => false_page(umbrage, one, read));
  }
  for (const one of config.hostile ?? []) {
    await check(`${one.rounds + (one.sealed ?? []).length} damaged files are answered or refused`,
      () => hostile(umbrage, one, read));
  }
  return checks;
}
