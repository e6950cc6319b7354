// SPDX-License-Identifier: Apache-2.0
// What the types allow and refuse; tests/harness/web_cases.py has tsc check it.
import * as umbrage from "umbrage";
export async function typed(): Promise<number> {
  const asset = await umbrage.open("x", { id: "12", memory: 5 });
  await asset.want({ camera: { eye: [1, 2, 3], target: [1, 2, 3], fov_y: 1 } }, { progress: (held) => held.pages > 3 });
  const a = await asset.query(new Float32Array(3), { taps: 9 });
  const b = await asset.query(new Float64Array(3), { taps: 9, format: "u8", bias: 0.5, bias_unit: "voxels" });
  const v: Float32Array = a.values, u: Uint8Array = b.values;
  // @ts-expect-error
  await asset.query([1, 2, 3]);
  // @ts-expect-error
  await asset.query(new Float32Array(3), { tap: 9 });
  return v[0] + u[0] + asset.info.lights.length;
}

export const code = (error: umbrage.UmbrageError): string => error.code;
