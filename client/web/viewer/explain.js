// SPDX-License-Identifier: Apache-2.0
// An explanation as text, line by line as `umbrage query --explain` prints it.

/** A number with `digits` significant digits, without zeros at its end. */
export function significant(value, digits) {
  const text = value.toPrecision(digits);
  if (text.includes("e")) {
    const [number, power] = text.split("e");
    return `${Number(number)}e${power[0]}${power.slice(1).padStart(2, "0")}`;
  }
  return value === 0 || Math.abs(value) >= 1e-4 ? String(Number(text)) : value.toExponential(digits - 1)
    .replace(/\.?0+e/, "e").replace(/e([+-])(\d)$/, "e$10$2");
}

export function explanationText(e, { value, bias = "auto" }) {
  const g = significant, flags = [[e.facing_away, ", faces away"], [e.outside, ", outside"],
    [e.before, ", before the first voxel"], [e.behind, ", behind the last voxel"],
    [e.undefined, ", undefined: too far from any surface"]];
  const lines = [`point 0: ${g(value, 9)}, ${e.lit_taps} of ${e.taps * e.taps} texels lit${
    flags.map(([holds, words]) => (holds ? words : "")).join("")}`];
  lines.push(`  bias ${bias}: moved ${g(e.bias_m, 6)} m ${e.has_normal
    ? `along the normal, which faces the light at cosine ${e.cosine.toFixed(4)}`
    : "towards the light: the point has no normal"}`);
  lines.push(`  to ${e.moved.map((each) => g(each, 9)).join(" ")}, voxel ${e.voxel.map((each) => each.toFixed(6)).join(" ")} ` +
    `(cell ${e.cell.join(" ")}) of frustum ${e.frustum}, ${g(e.voxel_size_m, 6)} m a ${e.level > 0 ? "cell" : "voxel"}`);
  if (e.level > 0) {
    lines.push(`  stops at cells of ${2 ** e.level} voxels a side`);
  }
  if (e.transmittance < 1) {
    lines.push(`  translucent casters leave ${g(e.transmittance, 6)} of the light`);
  }
  e.steps.forEach(({ level, state, index }, i) => {
    const where = i === 0 ? "cell" : level === 0 ? "brick" : "node";
    lines.push(`  level ${String(level).padStart(2)}: ${state.padEnd(8)} ${where} ${index}`);
  });
  if (e.taps > 1 && !e.facing_away) {
    lines.push(`  window of ${e.taps} x ${e.taps} texels from ${e.window.join(" ")} at depth ${e.cell[2]}:`);
    for (const row of e.rows) {
      lines.push(`    ${Array.from({ length: e.taps }, (_, i) => ((row >>> i) & 1 ? "#" : ".")).join("")}`);
    }
  }
  lines.push(`  cost: ${e.nodes} nodes and ${e.bricks} bricks read`);
  return lines.join("\n");
}
