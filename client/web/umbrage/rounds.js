// SPDX-License-Identifier: Apache-2.0
// Rounds of fetching, as in client/rpc/region.c: list what matters most, read it, lay it out.
import { UmbrageError } from "./errors.js";

const FIRST_BYTES = 16 << 10; // As in C: the coarse pages of most assets
const ROUND_BYTES_MIN = 512 << 10;
const BLOCK_BYTES = 4096; // Most bytes of a directory block
const ITEMS_MAX = 4096;

/** The part of an asset that is held, and the cost of fetching it. */
export function heldOf(module, counts) {
  module.call("stats");
  const [pages, pages_held, asset_bytes, held_bytes, memory_bytes, memory_peak_bytes, pages_dropped, builds, blocks,
    blocks_held] = module.numbers(10);
  return { pages, pages_held, asset_bytes, held_bytes, memory_bytes, memory_peak_bytes, pages_dropped, builds, blocks,
    blocks_held, ...counts };
}

/** Adds a page or block. Returns false if the memory budget is full. */
function addItem(module, name, item, bytes) {
  try {
    module.lend(bytes, (at) => module.run(name, item, at, bytes.length));
    return true;
  } catch (error) {
    if (error.code === "E_NO_MEMORY") {
      return false;
    }
    throw error;
  }
}

/** Reads the head and opens the asset, with the pages that the first read contains. */
export async function openFront(module, source, { id, memory, signal }, counts) {
  const read = async (offset, length) => {
    counts.requests++;
    counts.rounds++;
    const bytes = await source.read(offset, length, signal);
    counts.received_bytes += bytes.length;
    return bytes;
  };
  let front = await read(0, FIRST_BYTES);
  module.lend(front, (at) => module.run("read_head", at, front.length));
  const [open_bytes] = module.numbers(1);
  if (open_bytes > memory) {
    throw new UmbrageError("E_TOO_LARGE", `head: ${open_bytes} bytes, the memory budget is ${memory}`);
  }
  if (open_bytes > front.length) {
    const rest = await read(front.length, open_bytes - front.length), all = new Uint8Array(front.length + rest.length);
    all.set(front);
    all.set(rest, front.length);
    front = all;
  }
  const open = (at_id) => module.lend(front, (at) => module.run("open", at, front.length, at_id, memory));
  if (id) {
    module.lend(id, open);
  } else {
    open(0);
  }
  const { pages } = heldOf(module, counts);
  for (let page = 0; page < pages && module.call("locate", page) === 0; page++) {
    const [offset, length] = module.numbers(2);
    if (offset + length > front.length || !addItem(module, "add", page, front.subarray(offset, offset + length))) {
      break;
    }
    counts.pages_received++;
  }
  module.run("build");
}

/** Lists numbers of items by a function of the module. */
function list(module, name, most, ...values) {
  const at = module.room(4 * Math.max(most, 1));
  try {
    const count = name === "missing" ? module.call(name, at, most, ...values) : module.call(name, ...values, at, most);
    return Array.from(module.words(at, count));
  } finally {
    module.release(at);
  }
}

/** Ranges of items in ascending order; neighbours in the file share one. */
function rangesOf(module, kind, items) {
  const ranges = [];
  for (const item of items) {
    module.call(kind === "block" ? "locate_block" : "locate", item);
    const [offset, length] = module.numbers(2), last = ranges.at(-1);
    if (last && last.items.at(-1).item + 1 === item && last.offset + last.length === offset) {
      last.items.push({ item, length });
      last.length += length;
    } else {
      ranges.push({ kind, offset, length, items: [{ item, length }] });
    }
  }
  return ranges;
}

/** The ranges of a round of about so many bytes: blocks of the directory, then pages. */
function planRound(module, bytes) {
  const any = list(module, "missing_blocks", 1, 0).length + list(module, "missing", 1, 0).length > 0;
  if (!any) {
    return [];
  }
  const { blocks, blocks_held } = heldOf(module);
  const all = (blocks - blocks_held) * BLOCK_BYTES <= bytes / 16 ? 1 : 0;
  const room = Math.min(Math.floor(bytes / BLOCK_BYTES), ITEMS_MAX / 2);
  const block_items = list(module, "missing_blocks", room, all), used = block_items.length * BLOCK_BYTES;
  const page_items = used < bytes ? list(module, "missing", ITEMS_MAX - block_items.length, bytes - used) : [];
  page_items.sort((a, b) => a - b);
  return [...rangesOf(module, "block", block_items), ...rangesOf(module, "page", page_items)];
}

/** Adds the items of a range that came. */
function takeRange(module, range, bytes, round, counts) {
  counts.received_bytes += bytes.length;
  if (bytes.length !== range.length) {
    throw new UmbrageError("E_TRUNCATED", `${range.kind} ${range.items[0].item} of the file: ${bytes.length} bytes ` +
      `came of a range of ${range.length}`);
  }
  let at = 0;
  for (const { item, length } of range.items) {
    if (round.full) {
      return;
    }
    if (!addItem(module, range.kind === "block" ? "add_block" : "add", item, bytes.subarray(at, at + length))) {
      round.full = true;
      return;
    }
    round.added++;
    round.pages += range.kind === "page" ? 1 : 0;
    counts.pages_received += range.kind === "page" ? 1 : 0;
    at += length;
  }
}

/** Reads ranges, a few at a time, and adds each as it comes. The first failure ends all. */
async function readRanges(module, source, ranges, signal, round, counts) {
  const stop = new AbortController(), pass = () => stop.abort(signal.reason);
  let next = 0;
  const work = async () => {
    while (next < ranges.length && !stop.signal.aborted) {
      const range = ranges[next++];
      counts.requests++;
      takeRange(module, range, await source.read(range.offset, range.length, stop.signal), round, counts);
    }
  };
  signal.addEventListener("abort", pass);
  const workers = Array.from({ length: Math.min(source.parallel ?? 1, ranges.length) }, () =>
    work().catch((error) => {
      round.error ??= error;
      stop.abort();
    }));
  await Promise.all(workers);
  signal.removeEventListener("abort", pass);
  if (signal.aborted) {
    round.error = signal.reason;
  }
}

/** Bytes that the next round may take; 0 if the limit is reached. */
function roundBytes(module, { max_bytes, round_bytes }, counts, start) {
  const bytes = round_bytes || Math.max(heldOf(module).held_bytes / 4, ROUND_BYTES_MIN);
  const left = max_bytes ? Math.max(max_bytes - (counts.received_bytes - start), 0) : Infinity;
  return Math.floor(Math.min(bytes, left));
}

/** Fetches what views need, round by round. mark() tells the module which pages matter. */
export async function update(module, source, mark, options, counts) {
  const start = counts.received_bytes;
  for (;;) { // Ends: each round adds a page or a block, or is the last
    options.signal.throwIfAborted();
    const round = { full: false, added: 0, pages: 0, error: null };
    const bytes = roundBytes(module, options, counts, start);
    mark();
    const ranges = bytes > 0 ? planRound(module, bytes) : [];
    if (ranges.length === 0) {
      return;
    }
    counts.rounds++;
    await readRanges(module, source, ranges, options.signal, round, counts);
    if (round.pages > 0) { // Also after a failure: pages that came before it stay
      const { pages_dropped } = heldOf(module);
      module.run("build");
      round.full ||= heldOf(module).pages_dropped > pages_dropped;
    }
    if (round.error) {
      throw round.error;
    }
    if (round.pages > 0 && options.progress?.(heldOf(module, counts))) {
      return;
    }
    if (round.added === 0 || round.full) {
      return;
    }
  }
}
