// SPDX-License-Identifier: Apache-2.0
// Shadows of an asset in three.js (from r111 on, WebGL2): MeshStandardMaterial, MeshPhysicalMaterial and
// MeshPhongMaterial get them beside three's own shadow maps.
//
// A material's shader is extended by onBeforeCompile. Each light of the scene that stands where a light of the asset
// stands is multiplied by the asset's answer, and by three's own map if it casts one. The asset's data are in one
// texture and in uniforms of integers, which old versions of three cannot set. So this module sets them while the
// program is in use: three asks for the value of the uniform umbrage_overlay then.
import { WebGLNodes, glsl, setPlacement } from "./gpu.js";
import { require } from "./errors.js";
import { PixelAnswers } from "./three_pixels.js";

const LIGHTS_MAX = 16; // Of a material: 11 uniform vectors each
const OVERLAYS = ["none", "exact", "bound", "state", "share", "position", "normal"]; // The last four: for reading back
const SHADER_FILTERS = ["box", "tent"]; // The core answers the others
const FILTERS = [...SHADER_FILTERS, "gaussian", "penumbra"];

const declarations = `
${glsl}
#if UMBRAGE_FACES
uniform UmbragePlacement umbrage_at[6]; // Of one lamp
#else
uniform UmbragePlacement umbrage_at[UMBRAGE_LIGHTS]; // Of suns
#endif
uniform vec4 umbrage_lights[UMBRAGE_LIGHTS]; // Direction towards a sun with w = 0, or position of a lamp with w = 1
uniform int umbrage_taps;
uniform int umbrage_filter;
uniform int umbrage_overlay;
vec2 umbrage_answers[UMBRAGE_LIGHTS]; // Lower and upper limit
vec3 umbrage_position, umbrage_normal;
#if UMBRAGE_PIXELS
uniform highp sampler2DArray umbrage_pixels; // A layer a light; empty: nothing is answered yet
uniform vec2 umbrage_size; // Of this picture in pixels
#endif

// Answers this fragment's point; call it outside of branches, because the normal is that of the surface.
void umbrage_look(vec3 position) {
  umbrage_position = position;
  umbrage_normal = normalize(cross(dFdx(position), dFdy(position)));
  if (umbrage_overlay > 4) {
    return;
  }
  for (int i = 0; i < UMBRAGE_LIGHTS; i++) {
#if UMBRAGE_PIXELS
    ivec2 size = textureSize(umbrage_pixels, 0).xy;
    umbrage_answers[i] = size.x < 2 ? vec2(0.0, 1.0)
      : texelFetch(umbrage_pixels, ivec3(ivec2(gl_FragCoord.xy / umbrage_size * vec2(size)), i), 0).xy;
#elif UMBRAGE_FACES
    umbrage_answers[i] = umbrage_lamp_box(umbrage_at, UMBRAGE_FACES, position, umbrage_normal, umbrage_taps);
#else
    umbrage_answers[i] = umbrage_filter == 1 ? umbrage_tent(umbrage_at[i], position, umbrage_normal, umbrage_taps)
                                             : umbrage_box(umbrage_at[i], position, umbrage_normal, umbrage_taps);
#endif
  }
}

// Share of a light of the scene that reaches the point.
float umbrage_share(vec4 light) {
  float share = 1.0;
  for (int i = 0; i < UMBRAGE_LIGHTS; i++) {
    vec4 own = umbrage_lights[i];
    bool is_it = own.w == light.w && (light.w == 0.0 ? dot(own.xyz, light.xyz) > 0.99999
      : distance(own.xyz, light.xyz) < 1e-3 * (1.0 + length(light.xyz)));
    share *= is_it ? 0.5 * (umbrage_answers[i].x + umbrage_answers[i].y) : 1.0;
  }
  return share;
}

// Draws what is not exact as stripes, and where a shadow's boundary crosses the window as dots.
vec4 umbrage_mark(vec4 color) {
  if (umbrage_overlay > 4) {
    return vec4(umbrage_overlay == 5 ? umbrage_position : umbrage_normal, 1.0);
  }
  float missing = 0.0, mixed = 0.0;
  for (int i = 0; i < UMBRAGE_LIGHTS; i++) {
    vec2 both = umbrage_answers[i];
    missing = max(missing, both.y - both.x);
    mixed = max(mixed, both.x > 0.0 && both.x < 1.0 ? 1.0 : 0.0);
  }
  if (umbrage_overlay == 3) {
    return vec4(missing > 0.0 ? 0.0 : 1.0, 1.0, 0.0, 1.0);
  }
  if (umbrage_overlay == 4) { // Of the first light
    return vec4(0.5 * (umbrage_answers[0].x + umbrage_answers[0].y), 1.0, 0.0, 1.0);
  }
  float across = fract((gl_FragCoord.x + gl_FragCoord.y) / 12.0);
  vec2 cell = fract(gl_FragCoord.xy / 6.0) - 0.5;
  if (missing > 0.0) {
    vec3 stripe = across < 0.17 ? vec3(0.15, 0.08, 0.0) : vec3(1.0, 0.72, 0.25);
    return vec4(mix(color.rgb, stripe, across < 0.34 ? 0.85 : 0.2), color.a);
  }
  if (umbrage_overlay == 2 && mixed > 0.0) {
    return vec4(mix(color.rgb, dot(cell, cell) < 0.07 ? vec3(0.0) : vec3(0.55, 0.8, 1.0), 0.7), color.a);
  }
  return color;
}
`;

/** The chunk of three that adds up the lights, each multiplied by its share. */
function lightsChunk(THREE) {
  const where = { pointLight: ["position", "1.0"], spotLight: ["position", "1.0"], directionalLight: ["direction", "0.0"] };
  let chunk = THREE.ShaderChunk.lights_fragment_begin;
  for (const [name, [member, w]] of Object.entries(where)) {
    const from = chunk.search(new RegExp(`${name}\\s*=`)), call = chunk.indexOf("RE_Direct( directLight", from);
    require(from >= 0 && call >= 0, `THREE: revision ${THREE.REVISION} has an unknown shader of lights`);
    chunk = `${chunk.slice(0, call)}directLight.color *= umbrage_share( vec4( ${name}.${member}, ${w} ) );\n\t\t${
      chunk.slice(call)}`;
  }
  return `umbrage_look( - vViewPosition );\n${chunk}`;
}

/** Multiplies a column-major matrix by x y z w; gives x y z. */
function transform(m, [x, y, z], w) {
  return [0, 1, 2].map((row) => m[row] * x + m[4 + row] * y + m[8 + row] * z + m[12 + row] * w);
}

/** Shadows of one asset for the materials of one renderer: docs/guide/web.md has an example. */
export class Shadows {
  #THREE;
  #gl;
  #asset;
  #nodes;
  #unit;
  #chunk;
  #materials = new Set();
  #settings = { lights: [0], taps: 9, filter: "box", bias: "auto", overlay: "none" };
  #lights = []; // { light: its number, at: placements of its faces, place: four numbers for umbrage_lights }
  #programs = new WeakMap();
  #uploaded = false;
  #renderer;
  #pixels;
  #layout = ""; // What the shader's text depends on

  constructor(THREE, renderer, asset, settings = {}) {
    const gl = renderer.getContext();
    require(typeof WebGL2RenderingContext === "function" && gl instanceof WebGL2RenderingContext,
      "renderer: has no WebGL2 context");
    this.#THREE = THREE;
    this.#gl = gl;
    this.#asset = asset;
    this.#renderer = renderer;
    this.#nodes = new WebGLNodes(gl);
    this.#pixels = new PixelAnswers(THREE, gl, asset);
    this.#unit = gl.getParameter(gl.MAX_COMBINED_TEXTURE_IMAGE_UNITS) - 2; // And the next; three takes the first ones
    this.#pixels.clear(this.#unit + 1);
    this.#chunk = lightsChunk(THREE);
    this.set(settings);
  }

  /** Changes settings: lights (numbers or names), taps, filter, bias, overlay. */
  set(settings) {
    const next = { ...this.#settings, ...settings }, all = this.#asset.info.lights;
    require(Number.isInteger(next.taps) && next.taps % 2 === 1 && next.taps > 0 && next.taps < 18,
      `taps: ${next.taps}, must be odd, from 1 to 17`);
    require(FILTERS.includes(next.filter), `filter: ${next.filter}, must be one of ${FILTERS.join(", ")}`);
    require(OVERLAYS.includes(next.overlay), `overlay: ${next.overlay}, must be one of ${OVERLAYS.join(", ")}`);
    const indices = next.lights.map((light) => (typeof light === "string" ? all.findIndex((one) => one.name === light) : light));
    indices.forEach((index, i) => require(all[index] !== undefined, `lights: there is no light ${String(next.lights[i]).slice(0, 64)}`));
    require(indices.length > 0 && indices.length <= LIGHTS_MAX, `lights: ${indices.length}, must be 1 to ${LIGHTS_MAX}`);
    this.#settings = next;
    this.#lights = indices.map((light) => this.#lights.find((one) => one.light === light) ?? { light, at: [], place: [0, 0, 0, 2] });
    const layout = `${this.byShader} ${this.#faces} ${indices.length}`;
    if (layout !== this.#layout) {
      this.#layout = layout;
      this.#materials.forEach((material) => this.#define(material));
    }
  }

  get settings() {
    return { ...this.#settings };
  }

  /** True if the shader knows lights and filter (suns with box or tent, one lamp with box); else call answer() after each move of the camera. */
  get byShader() {
    const { filter } = this.#settings;
    return this.#faces > 0 ? filter === "box" : SHADER_FILTERS.includes(filter) &&
      this.#lights.every(({ light }) => this.#asset.info.lights[light].kind === "directional");
  }

  /** Faces of the lamp, if it is one lamp alone; else 0. */
  get #faces() {
    const { kind, frusta } = this.#asset.info.lights[this.#lights[0].light];
    return this.#lights.length === 1 && kind !== "directional" ? frusta : 0;
  }

  /** Bytes that the GPU got. */
  get bytesSent() {
    return this.#nodes.bytes_sent;
  }

  #define(material) {
    material.defines = { ...material.defines, UMBRAGE_LIGHTS: this.#lights.length,
      UMBRAGE_PIXELS: this.byShader ? 0 : 1, UMBRAGE_FACES: this.#faces };
    material.needsUpdate = true;
  }

  /** Extends a material, or those of an object and its descendants. Lambert's and basic materials
   * stay as they are. */
  add(target) {
    if (!target.isMaterial) {
      target.traverse((object) => [object.material ?? []].flat().forEach((material) => this.add(material)));
    } else if ((target.isMeshStandardMaterial || target.isMeshPhongMaterial) && !this.#materials.has(target)) {
      const before = target.onBeforeCompile;
      this.#materials.add(target);
      this.#define(target);
      target.onBeforeCompile = (shader, renderer) => {
        before?.call(target, shader, renderer);
        this.#extend(shader);
      };
      target.customProgramCacheKey = () => `umbrage ${before}`;
    }
    return this;
  }

  #extend(shader) {
    const gl = this.#gl, shadows = this;
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", `#include <common>\n${declarations}`)
      .replace("#include <lights_fragment_begin>", this.#chunk)
      .replace(/}\s*$/, "\tif ( umbrage_overlay > 0 ) gl_FragColor = umbrage_mark( gl_FragColor );\n}\n");
    shader.uniforms.umbrage_overlay = {
      get value() {
        shadows.#setUniforms(gl.getParameter(gl.CURRENT_PROGRAM));
        return OVERLAYS.indexOf(shadows.#settings.overlay);
      },
    };
  }

  /** Sets the uniforms that three.js cannot set, while the program is in use. */
  #setUniforms(program) {
    const gl = this.#gl, { filter, taps } = this.#settings;
    if (!this.#programs.has(program)) {
      const names = ["umbrage_data", "umbrage_filter", "umbrage_taps", "umbrage_lights[0]", "umbrage_pixels",
        "umbrage_size"];
      this.#programs.set(program, names.map((name) => gl.getUniformLocation(program, name)));
    }
    const [data, of_filter, of_taps, lights, pixels, size] = this.#programs.get(program);
    const [, , width, height] = gl.getParameter(gl.VIEWPORT);
    gl.uniform1i(data, this.#unit);
    gl.uniform1i(pixels, this.#unit + 1);
    gl.uniform2f(size, width, height);
    gl.uniform1i(of_filter, filter === "tent" ? 1 : 0);
    gl.uniform1i(of_taps, taps);
    gl.uniform4fv(lights, this.#lights.flatMap(({ place }) => place));
    this.#lights.flatMap(({ at }) => at).forEach((at, index) => setPlacement(gl, program, `umbrage_at[${index}]`, at));
  }

  /** Copies the changed entries of the asset to the GPU. Other state of the context stays. */
  #upload() {
    const gl = this.#gl;
    const active = gl.getParameter(gl.ACTIVE_TEXTURE);
    gl.activeTexture(gl.TEXTURE0 + this.#unit);
    this.#nodes.apply(this.#asset.changes());
    gl.bindTexture(gl.TEXTURE_2D, this.#nodes.texture);
    gl.activeTexture(active);
    this.#uploaded = true;
  }

  /** Call it before each render: places the lights for the camera. changed: pages came since the last call. */
  update(camera, { changed = true } = {}) {
    if (this.byShader && (changed || !this.#uploaded)) {
      this.#upload();
    }
    camera.updateMatrixWorld();
    const { bias } = this.#settings, { lights } = this.#asset.info;
    const view = camera.matrixWorldInverse;
    for (const one of this.#lights) {
      const { kind, direction, position } = lights[one.light], is_sun = kind === "directional";
      one.at = Array.from({ length: this.byShader ? Math.max(this.#faces, 1) : 0 }, (_, face) =>
        this.#asset.placement({ light: one.light, face, bias, to_world: camera.matrixWorld.elements }));
      one.place = is_sun ? [...transform(view.elements, direction.map((each) => -each), 0), 0]
        : [...transform(view.elements, position, 1), 1];
    }
  }

  /**
   * Answers the picture by the core, in width x height pixels, where the shader cannot (lamps, other filters). The next
   * render shows the answers, for the same camera.
   */
  async answer(scene, camera, width, height) {
    await this.#pixels.update(...this.#picture(scene, camera, width, height));
  }

  /**
   * Fetches the pages for the points that the camera sees, in width x height pixels. For casters that hide each other
   * this takes far fewer bytes than asset.want({ camera }). fetching: progress and signal, as for asset.want.
   */
  async want(scene, camera, width, height, fetching = {}) {
    await this.#pixels.want(...this.#picture(scene, camera, width, height), fetching);
  }

  /** Arguments of PixelAnswers: how to draw the scene, and for what. */
  #picture(scene, camera, width, height) {
    const { taps, filter, bias } = this.#settings;
    camera.updateMatrixWorld();
    const draw = (kind) => {
      const { overlay } = this.#settings;
      this.set({ overlay: kind });
      this.#renderer.render(scene, camera);
      this.set({ overlay });
    };
    return [this.#renderer, draw, { width, height, matrix: [...camera.matrixWorld.elements],
      lights: this.#lights.map(({ light }) => light), settings: { taps, filter, bias }, unit: this.#unit + 1 }];
  }

  /** Lights of three at the places of the asset's, for `settings.lights`. Suns and lamps cast no map of three's. */
  makeLights({ color = 0xffffff, intensity = 1, reach = 0 } = {}) {
    const THREE = this.#THREE, { bounds, lights } = this.#asset.info;
    const middle = [0, 1, 2].map((axis) => (bounds[0][axis] + bounds[1][axis]) / 2);
    return this.#lights.map(({ light: index }) => {
      const { kind, direction, position, name } = lights[index], is_sun = kind === "directional";
      const light = is_sun ? new THREE.DirectionalLight(color, intensity)
        : kind === "point" ? new THREE.PointLight(color, intensity, reach, 2)
          : new THREE.SpotLight(color, intensity, reach, 0.48 * Math.PI, 0.4, 2);
      light.name = name;
      light.position.set(...(is_sun ? middle.map((each, axis) => each - direction[axis]) : position));
      if (light.target) {
        light.target.position.set(...(is_sun ? middle : position.map((each, axis) => each + direction[axis])));
        light.target.updateMatrixWorld();
      }
      return light;
    });
  }
}
