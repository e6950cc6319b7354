// SPDX-License-Identifier: Apache-2.0
// The package's side of tests/bench/web_race.py in node: web_race.mjs PACKAGE FILE POINTS. As base_kernels.c.
import { readFile } from "node:fs/promises";
import { resolve } from "node:path";
import { createInterface } from "node:readline";
import { pathToFileURL } from "node:url";

const [library, path, points] = process.argv.slice(2);
const { open } = await import(pathToFileURL(resolve(library, "index.js")));
const numbers = new Float32Array(Uint8Array.from(await readFile(points)).buffer), count = numbers.length / 6;
const positions = new Float32Array(3 * count), normals = new Float32Array(3 * count);
for (let i = 0; i < count; i++) {
  positions.set(numbers.subarray(6 * i, 6 * i + 3), 3 * i);
  normals.set(numbers.subarray(6 * i + 3, 6 * i + 6), 3 * i);
}
const asset = await open(path, { memory: 2 ** 31 });
await asset.want({});
for await (const line of createInterface({ input: process.stdin })) {
  const [filter, taps] = line.split(" "), wide = filter === "footprint" ? { footprint_m: 2.5 } : {};
  const passes = wide.footprint_m ? 1 : 10, begin = process.cpuUsage().user; // The clock may tick every 10 ms
  for (let pass = 0; pass < passes; pass++) {
    await asset.query(positions, { filter, taps: Number(taps), normals, ...wide });
  }
  console.log(((process.cpuUsage().user - begin) * 1000 / count / passes).toFixed(3));
}
await asset.close();
