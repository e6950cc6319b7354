// SPDX-License-Identifier: Apache-2.0
// Data of an asset for a GPU: entries of 16 bytes, and placements (umbrage/gpu.h).
import { require } from "./errors.js";

const ENTRY_BYTES = 16;
const SPARE_LEAST = 1 << 16; // Entries of room for pages to come
const RANGES = 1024; // That are listed at a time
const BIAS_MODES = ["auto", "voxels", "metres", "none"];

/** Ranges of entries, as pairs of first and count. */
function listRanges(module) {
  const at = module.room(8 * RANGES), ranges = [];
  try {
    for (let count = RANGES; count === RANGES;) {
      count = module.call("gpu_changes", at, RANGES);
      ranges.push(...module.words(at, 2 * count));
    }
  } finally {
    module.release(at);
  }
  return ranges;
}

/** Entries that changed since the last call: { capacity, ranges, words }. The first call has all of them. */
export function takeChanges(module) {
  module.run("gpu_layout", SPARE_LEAST);
  const [capacity, is_new] = module.numbers(2);
  const ranges = is_new ? [0, capacity] : listRanges(module);
  let total = 0;
  for (let i = 1; i < ranges.length; i += 2) {
    total += ranges[i];
  }
  const words = new Uint32Array(total * ENTRY_BYTES / 4);
  for (let i = 0, done = 0; i < ranges.length; i += 2) {
    const [first, count] = [ranges[i], ranges[i + 1]], at = module.room(count * ENTRY_BYTES);
    try {
      module.call("gpu_write", first, count, at);
      words.set(module.words(at, count * ENTRY_BYTES / 4), done);
    } finally {
      module.release(at);
    }
    done += count * ENTRY_BYTES / 4;
  }
  return { capacity, ranges: Uint32Array.from(ranges), words };
}

const FIELDS = { row_x: Int32Array, row_y: Int32Array, row_z: Int32Array, row_w: Int32Array, low: Uint32Array,
  info: Int32Array, step_x: Float32Array, step_y: Float32Array, step_z: Float32Array, light: Float32Array,
  lamp: Float32Array, axis: Float32Array };
const PLACEMENT_BYTES = 16 * Object.keys(FIELDS).length;

/** Computes a placement: { bytes, fields, range_m, bound_voxels, bound_depth }. */
export function placementOf(module, light, face, origin, to_world, mode, bias) {
  require(BIAS_MODES.includes(mode), `bias: ${String(mode).slice(0, 40)}, must be one of ${BIAS_MODES.join(", ")}`);
  module.numbers(24).set([light, to_world ? 1 : 0, ...origin, ...(to_world ?? new Array(16).fill(0)),
    BIAS_MODES.indexOf(mode), bias, face]);
  module.run("gpu_place");
  const [range_m, bound_voxels, bound_depth] = module.numbers(3);
  const bytes = module.bytes(module.call("gpu_placement"), PLACEMENT_BYTES).slice().buffer;
  const fields = Object.fromEntries(Object.entries(FIELDS).map(([name, Kind], index) =>
    [name, new Kind(bytes, 16 * index, 4)]));
  return { bytes, fields, range_m, bound_voxels, bound_depth };
}
