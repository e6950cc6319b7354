// SPDX-License-Identifier: Apache-2.0
// The other side of the split picture: the same scene with cascaded shadow maps by three.js. Four lights share the sun's
// direction. Each has a shadow map that is fitted to a part of the view, and lights the pixels of that part alone.
import * as THREE from "./three/build/three.module.js";

const CASCADES = 4, TEXELS = 2048; // Each map has TEXELS x TEXELS
const TEXEL_BYTES = 4; // three packs a depth into RGBA
const PRACTICAL = 0.5; // Splits between even ones (0) and logarithmic ones (1), as in three's add-on CSM
const BIAS_TEXELS = 2; // Depth by which receivers move to the light; less leaves stripes

const declarations = `
uniform float cascade_ends[${CASCADES}]; // View depths in metres
uniform float cascade_bare; // 1: draws the share of light alone
`;
const choose = `
float cascade_weights[${CASCADES}], cascade_share = 0.0;
for ( int cascade = 0; cascade < ${CASCADES}; cascade ++ ) {
  cascade_weights[cascade] = ( vViewPosition.z < cascade_ends[cascade] || cascade == ${CASCADES - 1} ) &&
    ( cascade == 0 || vViewPosition.z >= cascade_ends[max( cascade - 1, 0 )] ) ? 1.0 : 0.0;
}
`;

/** three's chunk of lights, in which a light of a cascade has its weight. */
function lightsChunk() {
  const chunk = THREE.ShaderChunk.lights_fragment_begin, call = "RE_Direct( directLight", from = chunk.search(/directionalLight\s*=/);
  const at = chunk.indexOf(call, from);
  return `${choose}${chunk.slice(0, at)}directLight.color *= cascade_weights[ i ];
\t\tcascade_share += directLight.color.g / directionalLight.color.g;\n\t\t${chunk.slice(at)}`;
}

function extended(material, uniforms) {
  const copy = material.clone();
  copy.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    shader.fragmentShader = shader.fragmentShader.replace("#include <common>", `#include <common>\n${declarations}`)
      .replace("#include <lights_fragment_begin>", lightsChunk())
      .replace(/}\s*$/, "\tif ( cascade_bare > 0.5 ) gl_FragColor = vec4( cascade_share, 1.0, 0.0, 1.0 );\n}\n");
  };
  return copy;
}

export class Cascades {
  scene = new THREE.Scene();
  /** Settings of the maps; tests/bench/view_edges.py tries others. */
  settings = { practical: PRACTICAL, bias_texels: BIAS_TEXELS };
  #renderer;
  #lights = [];
  #box;
  #uniforms = { cascade_ends: { value: new Array(CASCADES).fill(0) }, cascade_bare: { value: 0 } };
  #towards = new THREE.Vector3(0, 1, 0);
  #drawn = ""; // What the maps were drawn for

  /** root: the scene's objects, which are copied; geometry and textures are shared. */
  constructor(renderer, root, ambient) {
    const copies = new Map(), own = (material) => {
      copies.set(material, copies.get(material) ?? extended(material, this.#uniforms));
      return copies.get(material);
    };
    const objects = root.clone();
    objects.traverse((object) => {
      if (object.isMesh) {
        object.material = Array.isArray(object.material) ? object.material.map(own) : own(object.material);
        object.castShadow = object.receiveShadow = true;
        const { map, alphaTest } = [object.material].flat()[0];
        if (alphaTest > 0) {
          object.customDepthMaterial = new THREE.MeshDepthMaterial({ depthPacking: THREE.RGBADepthPacking, map, alphaTest });
        }
      }
    });
    this.#renderer = renderer;
    this.#box = new THREE.Box3().setFromObject(root);
    this.scene.add(objects, ambient.clone());
    for (let i = 0; i < CASCADES; i++) {
      const light = new THREE.DirectionalLight();
      light.castShadow = true;
      light.shadow.mapSize.set(TEXELS, TEXELS);
      this.#lights.push(light);
      this.scene.add(light, light.target);
    }
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.autoUpdate = false;
    renderer.shadowMap.type = THREE.PCFSoftShadowMap;
  }

  /** Bytes of the maps on the GPU. */
  get bytes() {
    return CASCADES * TEXELS * TEXELS * TEXEL_BYTES;
  }

  get text() {
    return `cascades: ${(this.bytes / 1e6).toFixed(1)} MB, ${CASCADES} maps of ${TEXELS} x ${TEXELS}`;
  }

  /** True: the next pictures have shares of light in place of colours. */
  set bare(is_bare) {
    this.#uniforms.cascade_bare.value = is_bare ? 1 : 0;
  }

  /** sun: a light of three's at its place, whose colour and direction the cascades take. */
  setSun(sun) {
    this.#towards.copy(sun.position).sub(sun.target.position).normalize();
    for (const light of this.#lights) {
      light.color.copy(sun.color);
      light.intensity = sun.intensity;
    }
  }

  /** View depths at which the cascades begin and end, from the scene's nearest corner to its farthest. */
  #splits(camera) {
    const { min, max } = this.#box, depths = [];
    for (let i = 0; i < 8; i++) {
      const corner = new THREE.Vector3(i & 1 ? max.x : min.x, i & 2 ? max.y : min.y, i & 4 ? max.z : min.z);
      depths.push(-corner.applyMatrix4(camera.matrixWorldInverse).z);
    }
    const near = Math.max(camera.near, Math.min(...depths)), far = Math.max(Math.min(camera.far, Math.max(...depths)), near * 1.01);
    return Array.from({ length: CASCADES + 1 }, (_, i) => {
      const part = i / CASCADES, even = near + (far - near) * part, logarithmic = near * (far / near) ** part;
      return even + (logarithmic - even) * this.settings.practical;
    });
  }

  /** Fits the map of a light to a part of the view, by whole texels so that edges stand still while the camera moves. */
  #fit(light, camera, from, to) {
    const towards = this.#towards, toLight = new THREE.Matrix4();
    const up = Math.abs(towards.y) > 0.9 ? new THREE.Vector3(1, 0, 0) : new THREE.Vector3(0, 1, 0);
    const tall = Math.tan(camera.fov * Math.PI / 360), wide = tall * camera.aspect, corners = [];
    for (const depth of [from, to]) {
      for (const [x, y] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
        corners.push(new THREE.Vector3(x * wide * depth, y * tall * depth, -depth).applyMatrix4(camera.matrixWorld));
      }
    }
    const side = Math.max(corners[4].distanceTo(corners[6]), corners[0].distanceTo(corners[6])), texel = side / TEXELS;
    toLight.lookAt(towards, new THREE.Vector3(), up);
    const inverse = new THREE.Matrix4().getInverse(toLight), part = new THREE.Box3().setFromPoints(corners.map((each) => each.applyMatrix4(inverse)));
    const casters = this.#box.clone().applyMatrix4(inverse), middle = part.getCenter(new THREE.Vector3());
    middle.set(Math.floor(middle.x / texel) * texel, Math.floor(middle.y / texel) * texel, casters.max.z + texel);
    light.position.copy(middle).applyMatrix4(toLight);
    light.target.position.copy(light.position).sub(towards);
    light.shadow.camera.up.copy(up);
    const depth = casters.max.z - Math.min(casters.min.z, part.min.z) + 2 * texel;
    Object.assign(light.shadow.camera, { left: -side / 2, right: side / 2, top: side / 2, bottom: -side / 2, near: 0, far: depth });
    light.shadow.camera.updateProjectionMatrix();
    light.shadow.bias = -this.settings.bias_texels * texel / depth;
  }

  /** Places the maps for a camera. They are drawn again by the next render if something moved. */
  update(camera) {
    camera.updateMatrixWorld();
    const ends = this.#splits(camera), { bias_texels } = this.settings;
    const now = [...camera.matrixWorld.elements, camera.aspect, ...this.#towards.toArray(), ...ends, bias_texels].join(" ");
    if (now !== this.#drawn) {
      this.#drawn = now;
      this.#lights.forEach((light, i) => this.#fit(light, camera, ends[i], ends[i + 1]));
      this.#uniforms.cascade_ends.value = ends.slice(1);
      this.#renderer.shadowMap.needsUpdate = true;
    }
  }
}
