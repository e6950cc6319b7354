// SPDX-License-Identifier: Apache-2.0
// Counts of shaders against those of the core, and of partial assets while pages arrive.
import * as umbrage from "/package/index.js";
import { WebGL, WebGPU } from "./gpu_engines.mjs";

function assert(holds, message) {
  if (!holds) {
    throw new Error(message);
  }
}

const read = async (name) => (await fetch(`/files/${name}`)).arrayBuffer();
const totalOf = ({ filter, taps }) => filter === "coarse" ? 2 : filter === "tent" ? ((taps + 1) / 2) ** 4 : taps * taps;

/** Voxels, and distances to borders, that gpu_voxels wrote. */
function placesOf(bytes) {
  const words = new Int32Array(bytes), floats = new Float32Array(bytes), count = words.length / 6;
  const voxels = new Int32Array(4 * count), borders = new Float32Array(2 * count);
  for (let i = 0; i < count; i++) {
    voxels.set(words.subarray(6 * i, 6 * i + 4), 4 * i);
    borders.set(floats.subarray(6 * i + 4, 6 * i + 6), 2 * i);
  }
  return { voxels, borders };
}

/** All points by one filter: at given voxels none differs; with the shader's own placement only those near a border. */
async function compare(engine, asset, one, count) {
  const { voxels, borders } = placesOf(await read(one.places)), total = totalOf(one);
  const expected = new Float32Array(await read(one.expected)), placement = asset.placement(one);
  engine.voxels(voxels);
  const begin = performance.now();
  const alike = await engine.run({ ...one, alike: true }, placement);
  const took = performance.now() - begin;
  for (let i = 0; i < count; i++) {
    const wanted = Math.round(expected[i] * total);
    assert(alike[2 * i] === wanted && alike[2 * i + 1] === wanted,
      `point ${i}, voxel ${voxels.subarray(4 * i, 4 * i + 4)}: ${alike[2 * i]} to ${alike[2 * i + 1]}, not ${wanted}`);
  }
  const own = await engine.run({ ...one, alike: false }, placement);
  let differ = 0;
  for (let i = 0; i < count; i++) {
    if (own[2 * i] !== alike[2 * i] || own[2 * i + 1] !== alike[2 * i + 1]) {
      differ++;
      assert(borders[2 * i] <= placement.bound_voxels || borders[2 * i + 1] <= placement.bound_depth,
        `point ${i}: ${own[2 * i]}, not ${alike[2 * i]}, ${borders[2 * i]} and ${borders[2 * i + 1]} voxels from a border`);
    }
  }
  return `${count} pixels alike in ${took.toFixed(0)} ms; own placement: ${differ} differ, all within ` +
    `${placement.bound_voxels.toExponential(1)} voxels of a border (depth ${placement.bound_depth.toExponential(1)})`;
}

const SAME = 2 ** -12; // Between shares from floats and from doubles, where both read the same voxels

/** Penumbras and footprints, which both have shares instead of counts: few points lie so near a border that they differ. */
async function compareShares(engine, asset, one, count) {
  const expected = new Float32Array(await read(one.expected)), begin = performance.now(), every = Math.ceil(count / 4096);
  const got = new Float32Array((await engine.run({ ...one, every }, asset.placement(one))).buffer);
  const took = performance.now() - begin;
  let differ = 0, between = 0, asked = 0;
  for (let i = 0; i < count; i += (i + 1) % 64 === 0 ? 64 * (every - 1) + 1 : 1) {
    asked++;
    differ += Math.abs(got[2 * i] - expected[i]) > SAME || Math.abs(got[2 * i + 1] - expected[i]) > SAME;
    between += expected[i] > 0 && expected[i] < 1;
  }
  assert(differ <= asked / 1000, `${differ} of ${asked} points differ by more than 2^-12`);
  assert(between > asked / 50, `only ${between} of ${asked} points are neither lit nor shadowed`);
  return `${differ} of ${asked} pixels differ by more than 2^-12, ${between} between 0 and 1; ${took.toFixed(0)} ms`;
}

/** Bounds of a partial asset are those of the core after each round; a round costs its own bytes. */
async function stream(engine, config, points, count) {
  const asset = await umbrage.open(`/files/${config.asset}`), steps = [];
  const positions = new Float32Array(3 * count), normals = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) {
    positions.set(points.subarray(6 * i, 6 * i + 3), 3 * i);
    normals.set(points.subarray(6 * i + 3, 6 * i + 6), 3 * i);
  }
  const look = async (light, taps) => {
    const one = config.cases.find((each) => each.light === light && each.taps === taps), total = totalOf(one);
    engine.voxels(placesOf(await read(one.places)).voxels);
    const before = engine.bytes_sent, changes = asset.changes();
    engine.apply(changes);
    const sent = engine.bytes_sent - before, all = changes.capacity * 16;
    engine.apply(asset.changes());
    assert(engine.bytes_sent === before + sent, "nothing changed, and bytes were sent");
    const { low, high, exact_count } = await asset.query(positions, { light, taps, normals, bounds: true, want: false });
    const got = await engine.run({ ...one, alike: true }, asset.placement({ light }));
    for (let i = 0; i < count; i++) {
      assert(got[2 * i] === Math.round(low[i] * total) && got[2 * i + 1] === Math.round(high[i] * total),
        `point ${i}: ${got[2 * i]} to ${got[2 * i + 1]}, not ${low[i] * total} to ${high[i] * total}`);
    }
    steps.push({ sent, all, exact: exact_count });
  };
  await look(0, 9);
  for (let round = 0; round < 3; round++) {
    await asset.want({ light: 0, camera: config.camera, taps: 9 }, { round_bytes: 32768, progress: () => true });
    await look(0, 9);
  }
  for (let round = 0; round < 3; round++) {
    await asset.want({ light: 1, camera: config.camera, taps: 7 }, { round_bytes: 32768, progress: () => true });
    await look(1, 7);
  }
  await asset.want({ light: 1, camera: config.camera, taps: 7 });
  await look(1, 7);
  await look(0, 9);
  await asset.want({});
  await look(1, 7);
  assert(steps.at(-1).exact === count && steps[0].exact < count, "pages did not arrive step by step");
  assert(steps.slice(1).some(({ sent, all }) => sent > 0 && sent < all / 2), "every round sent the whole array");
  await asset.close();
  return steps.map(({ sent, all, exact }) => `${sent} of ${all} bytes, ${exact} exact`).join("; ");
}

export async function checks(name) {
  const done = [];
  const check = async (what, work) => {
    try {
      done.push({ name: `${name}: ${what}`, ok: true, detail: (await work()) ?? "" });
    } catch (error) {
      done.push({ name: `${name}: ${what}`, ok: false, detail: String(error.stack ?? error) });
    }
  };
  let engine;
  await check("the shaders compile", async () => {
    engine = await (name === "webgl" ? WebGL : WebGPU).make();
  });
  if (engine === null) {
    return [{ missing: true }];
  }
  if (engine) {
    const config = await (await fetch("/files/gpu.json")).json();
    const points = new Float32Array(await read(config.points)), count = points.length / 6;
    engine.points(points, count);
    const asset = await umbrage.open(`/files/${config.asset}`);
    await asset.want({});
    engine.apply(asset.changes());
    for (const one of config.cases) {
      await check(`${one.filter}, light ${one.light}, ${one.taps} taps, level ${one.level}`,
        () => (one.width ? compareShares : compare)(engine, asset, one, count));
    }
    await check("pages arrive", () => stream(engine, config, points, count));
  }
  return done;
}
