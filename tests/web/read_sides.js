// SPDX-License-Identifier: Apache-2.0
// Run in the viewer's page: what its sides say of each pixel. settings: of the cascades, if the picture is split.
(async (settings) => {
  const THREE = await import(new URL("three/build/three.module.js", location).href);
  const { renderer, scene, camera, shadows, cascades } = umbrageViewer.parts, { width, height } = renderer.domElement;
  const target = new THREE.WebGLRenderTarget(width, height, { type: THREE.FloatType, minFilter: THREE.NearestFilter,
    magFilter: THREE.NearestFilter, generateMipmaps: false });
  const read = (what) => {
    const pixels = new Float32Array(4 * width * height), alpha = renderer.getClearAlpha();
    renderer.setRenderTarget(target);
    renderer.setClearAlpha(0); // The sky is no point
    renderer.clear();
    renderer.render(what, camera);
    renderer.readRenderTargetPixels(target, 0, 0, width, height, pixels);
    renderer.setClearAlpha(alpha);
    renderer.setRenderTarget(null);
    return pixels;
  };
  const [positions, normals, ours] = ["position", "normal", "share"].map((overlay) => {
    shadows.set({ overlay });
    return read(scene);
  });
  shadows.set({ overlay: "none" });
  let theirs = new Float32Array(ours.length);
  if (cascades) {
    Object.assign(cascades.settings, settings);
    cascades.update(camera);
    cascades.bare = true;
    theirs = read(cascades.scene);
    cascades.bare = false;
  }
  target.dispose();
  const seen = [];
  for (let i = 0; i < width * height; i++) {
    if (positions[4 * i + 3] > 0) {
      seen.push(i);
    }
  }
  const points = new Float32Array(6 * seen.length), shares = new Float32Array(2 * seen.length), place = new THREE.Vector3();
  seen.forEach((pixel, i) => {
    points.set(place.fromArray(positions, 4 * pixel).applyMatrix4(camera.matrixWorld).toArray(), 6 * i);
    points.set(place.fromArray(normals, 4 * pixel).transformDirection(camera.matrixWorld).toArray(), 6 * i + 3);
    shares.set([ours[4 * pixel], theirs[4 * pixel]], 2 * i);
  });
  const text = (array) => {
    const bytes = new Uint8Array(array.buffer), parts = [];
    for (let at = 0; at < bytes.length; at += 32768) {
      parts.push(String.fromCharCode(...bytes.subarray(at, at + 32768)));
    }
    return btoa(parts.join(""));
  };
  return { width, height, points: text(points), shares: text(shares) };
})
