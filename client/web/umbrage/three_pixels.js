// SPDX-License-Identifier: Apache-2.0
// Answers of the core for the pixels of a picture, for lights and filters that the shader does not know: the scene is
// drawn once for positions and once for normals, the core answers, and a texture takes the answers to the shader.

/** View-space x y z of drawn pixels as world-space points. matrix: column major; w: 1 for places, 0 for directions. */
function toWorld(matrix, pixels, indices, out, w) {
  for (let i = 0; i < indices.length; i++) {
    const x = pixels[4 * indices[i]], y = pixels[4 * indices[i] + 1], z = pixels[4 * indices[i] + 2];
    for (let row = 0; row < 3; row++) {
      out[3 * i + row] = matrix[row] * x + matrix[4 + row] * y + matrix[8 + row] * z + matrix[12 + row] * w;
    }
  }
  return out;
}

export class PixelAnswers {
  /** WebGLTexture: two bytes a pixel and a layer a light, lower and upper limit. */
  texture = null;
  #THREE;
  #gl;
  #asset;
  #target = null;

  constructor(THREE, gl, asset) {
    this.#THREE = THREE;
    this.#gl = gl;
    this.#asset = asset;
    gl.getExtension("EXT_color_buffer_float");
    gl.getExtension("EXT_float_blend");
  }

  /** Draws the scene and reads the picture back. kind: "position" or "normal". */
  #read(renderer, draw, kind, width, height) {
    const THREE = this.#THREE, pixels = new Float32Array(4 * width * height);
    if (this.#target?.width !== width || this.#target.height !== height) {
      this.#target?.dispose();
      this.#target = new THREE.WebGLRenderTarget(width, height, { type: THREE.FloatType, minFilter: THREE.NearestFilter,
        magFilter: THREE.NearestFilter, generateMipmaps: false });
    }
    const before = renderer.getRenderTarget(), alpha = renderer.getClearAlpha();
    renderer.setClearAlpha(0); // The sky is no point
    renderer.setRenderTarget(this.#target);
    renderer.clear();
    draw(kind);
    renderer.setClearAlpha(alpha);
    renderer.readRenderTargetPixels(this.#target, 0, 0, width, height, pixels);
    renderer.setRenderTarget(before);
    return pixels;
  }

  /** The points of a picture: draw(kind) draws the scene; matrix: of the camera. */
  #look(renderer, draw, { width, height, matrix }) {
    const positions = this.#read(renderer, draw, "position", width, height);
    const normals = this.#read(renderer, draw, "normal", width, height), seen = [];
    for (let i = 0; i < width * height; i++) {
      if (positions[4 * i + 3] > 0) {
        seen.push(i);
      }
    }
    return { seen, points: toWorld(matrix, positions, seen, new Float64Array(3 * seen.length), 1),
      facing: toWorld(matrix, normals, seen, new Float32Array(3 * seen.length), 0) };
  }

  /** Fetches the pages that the answers of a picture need. Arguments: as of update; fetching: as of asset.want. */
  async want(renderer, draw, { lights, settings, ...picture }, fetching) {
    const { points, facing } = this.#look(renderer, draw, picture);
    for (let held = -1; held < this.#asset.held().held_bytes;) {
      let exact = 0;
      for (const light of lights) {
        exact += (await this.#asset.query(points, { ...settings, light, normals: facing })).exact_count;
      }
      if (exact === lights.length * points.length / 3) {
        return;
      }
      held = this.#asset.held().held_bytes;
      await this.#asset.want([], fetching);
    }
  }

  /**
   * Answers a picture. draw(kind) draws the scene; matrix: of the camera; lights: numbers; settings: of the query;
   * unit: texture unit for the answers.
   */
  async update(renderer, draw, { width, height, matrix, lights, settings, unit }) {
    const { seen, points, facing } = this.#look(renderer, draw, { width, height, matrix });
    const limits = new Uint8Array(2 * width * height * lights.length).fill(255);
    for (const [layer, light] of lights.entries()) {
      const answers = await this.#asset.query(points, { ...settings, light, normals: facing, bounds: true, want: false });
      for (let i = 0; i < seen.length; i++) {
        const at = 2 * (layer * width * height + seen[i]), low = answers.low[i], high = answers.high[i];
        limits[at] = 255 * low; // Rounded down
        limits[at + 1] = low === high ? limits[at] : Math.ceil(255 * high);
      }
    }
    this.#upload(limits, width, height, lights.length, unit);
  }

  /** Uploads one pixel without an answer, so that the shader has a texture. */
  clear(unit) {
    this.#upload(Uint8Array.of(0, 255), 1, 1, 1, unit);
  }

  #upload(limits, width, height, layers, unit) {
    const gl = this.#gl, active = gl.getParameter(gl.ACTIVE_TEXTURE), stores = [];
    for (const [name, value] of [["UNPACK_ALIGNMENT", 1], ["UNPACK_FLIP_Y_WEBGL", false],
      ["UNPACK_PREMULTIPLY_ALPHA_WEBGL", false]]) {
      stores.push([gl[name], gl.getParameter(gl[name])]);
      gl.pixelStorei(gl[name], value);
    }
    this.texture ??= gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.texture);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RG8, width, height, layers, 0, gl.RG, gl.UNSIGNED_BYTE, limits);
    for (const name of ["MIN_FILTER", "MAG_FILTER"]) {
      gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl[`TEXTURE_${name}`], gl.NEAREST);
    }
    gl.activeTexture(active);
    stores.forEach(([name, value]) => gl.pixelStorei(name, value));
  }
}
