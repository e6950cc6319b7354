// SPDX-License-Identifier: Apache-2.0
// The viewer: config.json names the asset and the scene; the address's # may set the view:
// #eye=X,Y,Z&target=X,Y,Z&fov=DEG&move=walk&light=N&taps=N&filter=tent&overlay=exact&beside=cascades&split=500
import * as THREE from "./three/build/three.module.js";
import * as umbrage from "./umbrage/index.js";
import { Shadows } from "./umbrage/three.js";
import { Cascades } from "./cascades.js";
import { explanationText, significant } from "./explain.js";
import { Moves } from "./moves.js";
import { loadScene } from "./scene.js";

const COUNT_SIDE = 128; // Points a side that the share of exact ones is counted on
const SEEN_SIDE = 512; // Pixels of the picture whose points are fetched first
const SLOW_MS = 250; // Pictures that take longer are drawn only when all pages of the view are there
const WHOLE_BYTES = 64 << 20; // Larger assets need a web server with byte ranges
const REST_MS = 150; // After this time without a move the pages of the view are fetched
const SPLIT_PX = 32; // Width of the thumb that is the border of the split picture
const LEGENDS = {
  exact: "Stripes: pages are missing, the answer has bounds only.",
  bound: "Stripes: pages are missing. Dots: a shadow's boundary crosses the window; it is right within the bound.",
};
const byId = (id) => document.getElementById(id);
const bytesText = (bytes) => (bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : `${(bytes / 1e6).toFixed(1)} MB`);

function fail(error) {
  const figures = byId("figures");
  figures.className = "error";
  figures.textContent = error.message ?? String(error);
}

class Viewer {
  /** State that tests and the line of figures read. */
  state = { ready: false, loading: 0, frames: 0, exact: 0, points: 0, frame_ms: 0, bound: 0, error: null };
  #asset;
  #canvas = byId("picture");
  #renderer;
  #scene = new THREE.Scene();
  #root;
  #camera;
  #moves;
  #shadows;
  #cascades = null; // Of the split picture
  #lights = [];
  #ambient = new THREE.HemisphereLight(0xdfeaf5, 0x8a8378, 0.4);
  #counter = new THREE.WebGLRenderTarget(COUNT_SIDE, COUNT_SIDE);
  #stop = null;
  #timer = 0;
  #dirty = true;
  #drawing = false;
  #changed = true;
  #last = 0;
  #size = 1;

  async start() {
    const config = await (await fetch("config.json")).json(), up = config.up === "z" ? 2 : 1;
    document.title = byId("name").textContent = config.name;
    this.#asset = await umbrage.open(new URL(config.asset, location).href, { id: config.id, apart: true,
      whole_bytes: WHOLE_BYTES });
    this.#root = await loadScene(config, this.#asset.info, up);
    const context = this.#canvas.getContext("webgl2", { antialias: true, powerPreference: "high-performance" });
    if (!context) {
      throw new Error("this browser has no WebGL2");
    }
    this.#renderer = new THREE.WebGLRenderer({ canvas: this.#canvas, context });
    this.#renderer.gammaOutput = true;
    this.#renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.#scene.add(this.#root, this.#ambient);
    this.#ambient.position.set(0, up === 1 ? 1 : 0, up === 2 ? 1 : 0);
    const hash = new URLSearchParams(location.hash.slice(1));
    this.#placeCamera(hash, up);
    this.#shadows = new Shadows(THREE, this.#renderer, this.#asset, { lights: [0] });
    this.#shadows.add(this.#root);
    this.#bind(hash);
    this.#resize();
    new ResizeObserver(() => this.#resize()).observe(this.#canvas.parentElement);
    requestAnimationFrame((now) => this.#frame(now));
    this.state.ready = true;
  }

  #placeCamera(hash, up) {
    const box = new THREE.Box3().setFromObject(this.#root), size = box.getSize(new THREE.Vector3());
    const [low, high] = this.#asset.info.bounds, middle = low.map((each, axis) => (each + high[axis]) / 2);
    const casters = Math.hypot(...high.map((each, axis) => each - low[axis]));
    const numbers = (name, otherwise) => hash.get(name)?.split(",").map(Number) ?? otherwise;
    this.#size = Math.max(casters, 1e-3);
    const away = up === 1 ? [0.36, 0.36, 0.46] : [0.36, -0.46, 0.36];
    const far = Math.max(size.length(), this.#size) * 4;
    this.#camera = new THREE.PerspectiveCamera(Number(hash.get("fov") ?? 50), 1, this.#size / 5000, far);
    this.#camera.up.set(0, up === 1 ? 1 : 0, up === 2 ? 1 : 0);
    this.#camera.position.set(...numbers("eye", middle.map((each, axis) => each + away[axis] * this.#size)));
    const target = numbers("target", middle);
    this.#camera.lookAt(...target);
    this.#moves = new Moves(this.#camera, this.#canvas, byId("pad"), { target, size: this.#size,
      changed: () => this.#moved() });
  }

  // --- controls ---

  #bind(hash) {
    const { lights } = this.#asset.info, lamps = lights.flatMap(({ kind }, i) => (kind === "directional" ? [] : [i]));
    const suns = lights.flatMap(({ kind }, i) => (kind === "directional" ? [i] : []));
    const options = lights.map(({ name, kind }, i) => [String(i), `${name} (${kind === "directional" ? "sun" : kind})`]);
    if (lamps.length > 1 && lamps.length <= 16) {
      options.push([lamps.join(","), `all ${lamps.length} lamps`]);
    }
    byId("light").replaceChildren(...options.map(([value, text]) => new Option(text, value)));
    byId("day").hidden = suns.length < 2;
    byId("sun").max = suns.length - 1;
    byId("sun").addEventListener("input", () => this.#choose("light", String(suns[byId("sun").value])));
    byId("split").value = hash.get("split") ?? byId("split").value;
    byId("split").addEventListener("input", () => {
      this.#dirty = true;
    });
    for (const name of ["light", "taps", "filter", "overlay", "beside", "move"]) {
      byId(name).addEventListener("input", () => this.#choose(name, byId(name).value));
      this.#choose(name, hash.get(name) ?? byId(name).value);
    }
    byId("panel").open = innerWidth > 800;
    byId("all").addEventListener("click", () => this.#want((fetching) => this.#asset.want({}, fetching)));
    byId("close").addEventListener("click", () => this.#unmark());
    this.#canvas.addEventListener("pointerdown", (event) => {
      this.pressed = [event.clientX, event.clientY];
    });
    this.#canvas.addEventListener("click", (event) => {
      if (this.pressed && Math.hypot(event.clientX - this.pressed[0], event.clientY - this.pressed[1]) < 5) {
        const box = this.#canvas.getBoundingClientRect();
        this.explainAt((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height).catch(fail);
      }
    });
    addEventListener("keydown", (event) => this.#key(event));
  }

  /** Sets a control, as if the user had. */
  #choose(name, value) {
    const control = byId(name), before = control.value;
    control.value = value;
    if (control.value !== value) {
      control.value = before; // Not a value of this asset
    }
    if (name === "light") {
      this.#setLights(control.value.split(",").map(Number));
    } else if (name === "taps") {
      this.#shadows.set({ taps: Number(control.value) });
      byId("taps-text").textContent = `${control.value} x ${control.value}`;
    } else if (name === "filter") {
      this.#setFilter(control.value).catch(fail);
    } else if (name === "overlay") {
      this.#shadows.set({ overlay: control.value });
      byId("legend").textContent = LEGENDS[control.value] ?? "";
      byId("legend").hidden = control.value === "none";
    } else if (name === "beside") {
      this.#setBeside(control.value === "cascades");
    } else {
      this.#moves.mode = control.value;
      byId("pad").hidden = control.value !== "walk";
    }
    this.#moved();
  }

  /** Penumbras need all pages, and data that not every asset has; the core's error names what is
   * missing. */
  async #setFilter(filter) {
    if (filter === "penumbra") {
      await this.#want((fetching) => this.#asset.want({}, fetching));
    }
    try {
      const { taps, lights } = this.#shadows.settings;
      await this.#asset.query(new Float64Array(3), { taps, filter, light: lights[0], want: false });
    } catch (error) {
      byId("filter").value = this.#shadows.settings.filter;
      throw error;
    }
    this.#shadows.set({ filter });
    this.#moved();
  }

  #setLights(indices) {
    const suns = this.#asset.info.lights.flatMap(({ kind }, i) => (kind === "directional" ? [i] : []));
    const place = suns.indexOf(indices[0]);
    this.#shadows.set({ lights: indices });
    this.#scene.remove(...this.#lights);
    this.#lights = this.#shadows.makeLights({ color: 0xfff6e8, intensity: place >= 0 ? 0.62 : 0.4, reach: this.#size * 2 });
    this.#scene.add(...this.#lights);
    if (place >= 0) {
      byId("sun").value = place;
    }
    byId("beside").disabled = place < 0; // Cascades are of a sun
    this.#setBeside(place >= 0 && byId("beside").value === "cascades");
    byId("sun").setAttribute("aria-valuetext", this.#asset.info.lights[indices[0]].name);
  }

  /** Shows cascaded shadow maps on the right of the border, or the whole picture by the asset. */
  #setBeside(is_split) {
    if (is_split) {
      this.#cascades ??= new Cascades(this.#renderer, this.#root, this.#ambient);
      this.#cascades.setSun(this.#lights[0]);
      byId("theirs").textContent = this.#cascades.text;
    }
    byId("split-view").hidden = !is_split;
  }

  #step(name, by) {
    const control = byId(name);
    if (control.options && !control.disabled) {
      const next = (control.selectedIndex + by + control.options.length) % control.options.length;
      this.#choose(name, control.options[next].value);
    } else if (!control.disabled) {
      this.#choose(name, String(Number(control.value) + by * Number(control.step)));
    }
  }

  #key(event) {
    const does = { BracketLeft: ["taps", -1], BracketRight: ["taps", 1], Comma: ["light", -1], Period: ["light", 1],
      KeyO: ["overlay", 1], KeyC: ["beside", 1], KeyM: ["move", 1] }[event.code];
    const in_panel = event.target.closest?.("aside, #split-view"), held = event.ctrlKey || event.metaKey || event.altKey;
    if (held || (in_panel && !/^(Bracket|Key|Comma|Period)/.test(event.code)) || event.target.tagName === "SELECT") {
      return;
    }
    if (does) {
      this.#step(...does);
    } else if (event.code === "Enter" && event.target === this.#canvas) {
      this.explainAt(0.5, 0.5).catch(fail);
    } else if (event.code === "Escape") {
      this.#unmark();
    } else if (!this.#moves.press(event.code)) {
      return;
    }
    event.preventDefault();
  }

  // --- pages ---

  #moved() {
    this.#dirty = true;
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => {
      this.#changed = this.#dirty = true;
      this.#want((fetching) => this.#wantSeen(fetching));
    }, REST_MS);
    this.#placeMark();
  }

  /** Fetches what the points of the picture need: those of a small picture, and of every pixel where a GPU draws. */
  async #wantSeen(fetching) {
    const { width, height } = this.#canvas, small = Math.min(1, SEEN_SIDE / Math.max(width, height));
    const seen = (share) => this.#shadows.want(this.#scene, this.#camera, Math.ceil(width * share), Math.ceil(height * share), fetching);
    if (this.#shadows.settings.filter !== "penumbra") { // It has the whole asset
      await seen(small);
      if (small < 1 && this.state.frames > 0 && this.state.frame_ms < SLOW_MS) {
        await seen(1);
      }
    }
  }

  /** Fetches by a function; a later want ends an earlier one. */
  async #want(fetch_by) {
    const stop = new AbortController();
    this.#stop?.abort(new DOMException("a later view", "AbortError"));
    this.#stop = stop;
    this.state.loading++;
    const came = (is_last) => {
      this.#changed = true;
      this.#dirty ||= is_last || this.state.frame_ms < SLOW_MS; // Without a GPU a picture takes seconds
    };
    try {
      await fetch_by({ signal: stop.signal, progress: () => came(false) });
      came(true);
    } catch (error) {
      if (!stop.signal.aborted) {
        this.state.error = error;
        fail(error);
      }
    } finally {
      this.state.loading--;
    }
  }

  // --- pictures ---

  #resize() {
    const { clientWidth, clientHeight } = this.#canvas.parentElement;
    this.#renderer.setSize(clientWidth, clientHeight, false);
    this.#camera.aspect = clientWidth / Math.max(clientHeight, 1);
    this.#camera.updateProjectionMatrix();
    this.#moved();
  }

  #frame(now) {
    requestAnimationFrame((next) => this.#frame(next));
    this.#moves.frame((now - this.#last) / 1000);
    this.#last = now;
    if (!this.#dirty || this.state.error) {
      return;
    }
    if (!this.#drawing) {
      this.#dirty = false;
      this.#drawing = true;
      this.#draw().catch((error) => {
        this.state.error = error;
        fail(error);
      }).finally(() => {
        this.#drawing = false;
      });
    }
  }

  async #draw() {
    const sky = getComputedStyle(document.documentElement).getPropertyValue("--sky").trim(), gl = this.#renderer.getContext();
    const begun = performance.now(), pixel = new Uint8Array(4);
    this.#renderer.setClearColor(new THREE.Color(sky), 1);
    this.#shadows.update(this.#camera, { changed: this.#changed });
    const counts = this.#changed;
    this.#changed = false;
    if (!this.#shadows.byShader) { // Coarse while the camera moves
      const { width, height } = this.#canvas, share = counts ? 1 : 4;
      await this.#shadows.answer(this.#scene, this.#camera, Math.ceil(width / share), Math.ceil(height / share));
      this.#shadows.update(this.#camera, { changed: false });
    }
    this.#drawSides();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // Waits for the picture
    this.state.frame_ms = performance.now() - begun;
    this.state.direction = this.#camera.getWorldDirection(new THREE.Vector3()).toArray().join(" ");
    if (counts) { // Not while the camera moves
      this.#count();
    }
    this.state.frames++;
    await this.#showFigures();
  }

  /** Draws the picture: by the asset, and on the right of the border by cascades. */
  #drawSides() {
    const { clientWidth: width, clientHeight: height } = this.#canvas, is_split = !byId("split-view").hidden;
    const border = is_split ? Math.round(SPLIT_PX / 2 + (width - SPLIT_PX) * byId("split").value / byId("split").max) : width;
    this.#renderer.setScissorTest(is_split);
    this.#renderer.setScissor(0, 0, border, height);
    this.#renderer.render(this.#scene, this.#camera);
    if (is_split) {
      this.#cascades.update(this.#camera);
      this.#renderer.setScissor(border, 0, width - border, height);
      this.#renderer.render(this.#cascades.scene, this.#camera);
      this.#renderer.setScissorTest(false);
    }
  }

  /** Counts the exact points of a small picture. */
  #count() {
    const { overlay } = this.#shadows.settings, pixels = new Uint8Array(4 * COUNT_SIDE * COUNT_SIDE);
    this.#shadows.set({ overlay: "state" });
    this.#renderer.setClearColor(0x000000, 0);
    this.#renderer.setRenderTarget(this.#counter);
    this.#renderer.clear();
    this.#renderer.render(this.#scene, this.#camera);
    this.#renderer.readRenderTargetPixels(this.#counter, 0, 0, COUNT_SIDE, COUNT_SIDE, pixels);
    this.#renderer.setRenderTarget(null);
    this.#shadows.set({ overlay });
    this.state.points = this.state.exact = 0;
    for (let i = 0; i < pixels.length; i += 4) {
      this.state.points += pixels[i + 1] > 127 && pixels[i + 2] < 128 ? 1 : 0;
      this.state.exact += pixels[i + 1] > 127 && pixels[i + 2] < 128 && pixels[i] > 127 ? 1 : 0;
    }
  }

  async #showFigures() {
    const { lights, taps, filter } = this.#shadows.settings, { pages, pages_held, received_bytes, asset_bytes } = this.#asset.held();
    const { bound } = await this.#asset.query(new Float64Array(3), { light: lights[0], taps, filter, want: false });
    const { exact, points, frame_ms } = this.state, share = points > 0 ? Math.floor(1000 * exact / points) / 10 : 100;
    this.state.bound = bound;
    const parts = [["fetched", `${bytesText(received_bytes)} of ${bytesText(asset_bytes)}`],
      ["pages", `${pages_held} of ${pages}`], ["exact", `${share} % of the points`],
      ["bound", bound > 0 ? `${significant(bound, 3)} m` : "none"], ["frame", frame_ms < 1000 ? `${frame_ms.toFixed(1)} ms` : `${(frame_ms / 1000).toFixed(1)} s`]];
    byId("ours").textContent = `umbrage: ${bytesText(received_bytes)}, ${bytesText(this.#shadows.bytesSent)} sent to the GPU`;
    byId("figures").className = "";
    byId("figures").replaceChildren(...parts.map(([name, text]) => {
      const part = document.createElement("span"), value = document.createElement("b");
      value.textContent = text;
      part.append(`${name} `, value);
      return part;
    }));
  }

  // --- a point's explanation ---

  get asset() {
    return this.#asset;
  }

  /** Draws again, with counts. */
  draw() {
    this.#changed = this.#dirty = true;
  }

  /** For tests that read pictures back. */
  get parts() {
    return { renderer: this.#renderer, scene: this.#scene, camera: this.#camera, shadows: this.#shadows, cascades: this.#cascades };
  }

  /** The point at a place of the picture, 0 to 1 from the left and from above, and its normal; null: sky. */
  pointAt(x, y) {
    const ray = new THREE.Raycaster(), pointer = new THREE.Vector2(2 * x - 1, 1 - 2 * y);
    ray.setFromCamera(pointer, this.#camera);
    const [hit] = ray.intersectObject(this.#root, true);
    if (!hit) {
      return null;
    }
    const normal = hit.face.normal.clone().applyMatrix3(new THREE.Matrix3().getNormalMatrix(hit.object.matrixWorld)).normalize();
    if (normal.dot(ray.ray.direction) > 0) {
      normal.negate();
    }
    return { place: hit.point, facing: normal };
  }

  /** Explains the point at a place of the picture. */
  async explainAt(x, y) {
    const found = this.pointAt(x, y);
    if (!found) {
      this.#unmark();
      return null;
    }
    const { place, facing } = found;
    const { lights, taps, filter } = this.#shadows.settings, point = place.toArray();
    const normal = Array.from(Float32Array.from(facing.toArray())); // As a file of points holds it
    const settings = { light: lights[0], taps, filter, bounds: true, normals: Float32Array.from(normal) };
    let answers = await this.#asset.query(Float64Array.from(point), settings);
    if (answers.exact_count === 0) { // The pages of this point alone
      await this.#asset.want();
      this.#changed = this.#dirty = true;
      answers = await this.#asset.query(Float64Array.from(point), settings);
    }
    const value = answers.values[0], is_exact = answers.exact[0] === 1;
    const explanation = this.#asset.explain(point, { light: lights[0], taps, filter, normal });
    const text = explanationText(explanation, { value });
    this.state.picked = { point, normal, value, is_exact, bound: answers.bound, explanation, text };
    byId("verdict").textContent = `${significant(100 * value, 3)} % of the light "${this.#asset.info.lights[lights[0]].name}", ${
      is_exact ? "exact" : `between ${significant(answers.low[0], 3)} and ${significant(answers.high[0], 3)}`}. ${answers.bound > 0
      ? `True, or a true shadow boundary is at most ${significant(answers.bound, 3)} m away.` : ""} Point ${
      point.map((each) => significant(each, 6)).join(", ")}, normal ${normal.map((each) => significant(each, 3)).join(", ")}.`;
    byId("explanation").textContent = text;
    byId("answer").hidden = false;
    this.mark = place.clone();
    this.#placeMark();
    return this.state.picked;
  }

  #unmark() {
    this.mark = null;
    byId("answer").hidden = true;
    this.#placeMark();
  }

  #placeMark() {
    const mark = byId("mark");
    this.#camera.updateMatrixWorld();
    const place = this.mark?.clone().project(this.#camera);
    mark.hidden = !place || Math.abs(place.z) > 1;
    if (!mark.hidden) {
      mark.style.left = `${50 + 50 * place.x}%`;
      mark.style.top = `${50 - 50 * place.y}%`;
    }
  }
}

const viewer = new Viewer();
globalThis.umbrageViewer = viewer; // For tests and the console
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => viewer.state.ready && location.reload());
viewer.start().catch((error) => {
  viewer.state.error = error;
  fail(error);
});
