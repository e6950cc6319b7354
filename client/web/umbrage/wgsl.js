// SPDX-License-Identifier: Apache-2.0
// Translates the shaders' walk from GLSL to WGSL, so that the package has one text of it. The text is that of
// client/gpu/shaders.py: without comments, and without blanks beside signs. A test compares the result with umbrage.wgsl.
const TYPES = { uint: "u32", int: "i32", float: "f32", uvec2: "vec2u", uvec4: "vec4u", ivec3: "vec3i", ivec4: "vec4i",
  vec2: "vec2f", vec3: "vec3f", vec4: "vec4f" };
const TYPE = `(${Object.keys(TYPES).join("|")}|bool|U\\w+)`;

/** A parameter's type and name. */
function parameter(text) {
  const [, type, name, length] = text.match(/^(\w+) (\w+)(?:\[(\d+)\])?$/);
  return `${name}: ${length ? `array<${type},${length}>` : type}`;
}

export function toWgsl(source) {
  return source
    .replace(/struct (\w+) \{(.*?)\};/g, (_, name, fields) =>
      `struct ${name} {${fields.replace(/(\w+) (\w+);/g, "$2: $1,")}}`)
    .replace(new RegExp(`(^|[};])${TYPE} (u\\w+)\\(([^()]*)\\)\\{`, "g"), (_, before, type, name, parameters) =>
      `${before}fn ${name}(${parameters.split(",").map(parameter)}) -> ${type}{`)
    .replace(new RegExp(`([{};(])${TYPE} (\\w+)(?=[=;])`, "g"), "$1var $3: $2")
    .replace(new RegExp(`\\b(${Object.keys(TYPES).join("|")})\\b`, "g"), (type) => TYPES[type]);
}
