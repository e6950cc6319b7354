// SPDX-License-Identifier: Apache-2.0
// The scene's file as objects of three.js.
import * as THREE from "./three/build/three.module.js";
import { GLTFLoader } from "./three/examples/jsm/loaders/GLTFLoader.js";
import { MTLLoader } from "./three/examples/jsm/loaders/MTLLoader.js";
import { OBJLoader } from "./three/examples/jsm/loaders/OBJLoader.js";
import { PLYLoader } from "./three/examples/jsm/loaders/PLYLoader.js";
import { STLLoader } from "./three/examples/jsm/loaders/STLLoader.js";

function load(loader, path) {
  return new Promise((resolve, reject) => loader.load(path, resolve, undefined, reject));
}

function meshOf(geometry) {
  if (!geometry.attributes.normal) {
    geometry.computeVertexNormals();
  }
  const vertexColors = geometry.attributes.color ? THREE.VertexColors : THREE.NoColors;
  return new THREE.Mesh(geometry, new THREE.MeshStandardMaterial({ color: 0xc8c4bc, roughness: 1, vertexColors }));
}

/** OBJ: with the library of materials that its first lines name. */
async function loadObj(path) {
  const loader = new OBJLoader(), folder = path.slice(0, path.lastIndexOf("/") + 1);
  const text = await (await fetch(path)).text(), library = /^mtllib[ \t]+(.*?)\s*$/m.exec(text);
  if (library) {
    const materials = await load(new MTLLoader().setPath(folder), library[1].replaceAll("\\", "/")).catch(() => null);
    materials?.preload();
    loader.setMaterials(materials);
  }
  return loader.parse(text);
}

const LOADERS = {
  glb: async (path) => (await load(new GLTFLoader(), path)).scene,
  gltf: async (path) => (await load(new GLTFLoader(), path)).scene,
  obj: loadObj,
  ply: async (path) => meshOf(await load(new PLYLoader(), path)),
  stl: async (path) => meshOf(await load(new STLLoader(), path)),
};

/** Without a scene: a plane under the casters' box. */
function plane({ bounds: [low, high] }, up) {
  const [a, b] = [0, 1, 2].filter((axis) => axis !== up);
  const size = Math.max(high[a] - low[a], high[b] - low[b]) * 1.5;
  const mesh = new THREE.Mesh(new THREE.PlaneBufferGeometry(size, size),
    new THREE.MeshStandardMaterial({ color: 0xc8c4bc, roughness: 1 }));
  const at = low.map((each, axis) => (axis === up ? each : (each + high[axis]) / 2));
  mesh.position.set(...at);
  mesh.rotation.x = up === 1 ? -Math.PI / 2 : 0;
  return mesh;
}

/**
 * Materials that can have shadows: Lambert's and basic ones become standard ones. glTF's default is metal, which is
 * black without surroundings to reflect.
 */
function standard(material) {
  material.metalness = material.metalnessMap ? material.metalness : 0;
  if (material.isMeshStandardMaterial || material.isMeshPhongMaterial) {
    return material;
  }
  const { color, map, side, transparent, opacity, alphaTest, vertexColors } = material;
  return new THREE.MeshStandardMaterial({ color, map, side, transparent, opacity, alphaTest, vertexColors, roughness: 1 });
}

/** Loads the scene that config.json names. up: 1 or 2. */
export async function loadScene(config, info, up) {
  const ending = config.scene?.split(".").pop().toLowerCase();
  const path = config.scene?.split("/").map(encodeURIComponent).join("/");
  const root = path ? await LOADERS[ending](path) : plane(info, up), lights = [];
  root.traverse((object) => {
    if (object.isLight) {
      lights.push(object);
    }
    if (object.isMesh) {
      object.material = Array.isArray(object.material) ? object.material.map(standard) : standard(object.material);
    }
  });
  lights.forEach((light) => light.parent.remove(light)); // The asset's lights stand in their places
  root.updateMatrixWorld(true);
  return root;
}
