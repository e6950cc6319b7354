// SPDX-License-Identifier: Apache-2.0
// Stands in for the canvas of docs/examples/webgpu.html, since headless Chromium without a GPU presents none of WebGPU:
// the page draws into a texture. When it is done, the brightnesses of its last picture go to /result/example.
let device, format, texture;
document.documentElement.style = "width: 320px; height: 240px";
HTMLCanvasElement.prototype.getContext = function getContext() {
  return {
    configure(options) {
      ({ device, format } = options);
    },
    getCurrentTexture: () => {
      texture?.destroy();
      texture = device.createTexture({ size: [this.width, this.height], format,
        usage: GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC });
      return texture;
    },
  };
};

/** Counts of the picture's pixels by the upper half of their second byte. */
async function countColours() {
  const bytesPerRow = Math.ceil(texture.width / 64) * 256, colours = {};
  const buffer = device.createBuffer({ size: bytesPerRow * texture.height, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
  const encoder = device.createCommandEncoder();
  encoder.copyTextureToBuffer({ texture }, { buffer, bytesPerRow }, [texture.width, texture.height]);
  device.queue.submit([encoder.finish()]);
  await buffer.mapAsync(GPUMapMode.READ);
  const bytes = new Uint8Array(buffer.getMappedRange());
  for (let y = 0; y < texture.height; y++) {
    for (let x = 0; x < texture.width; x++) {
      const value = bytes[y * bytesPerRow + 4 * x + 1] >> 4;
      colours[value] = (colours[value] ?? 0) + 1;
    }
  }
  return colours;
}

const report = (result) => fetch("/result/example", { method: "POST", body: JSON.stringify(result) });
addEventListener("unhandledrejection", ({ reason }) => report({ figures: String(reason?.message ?? reason), colours: {} }));
addEventListener("error", ({ message }) => report({ figures: message, colours: {} }));
new MutationObserver(async () => {
  const figures = document.getElementById("figures")?.textContent ?? "opening";
  if (figures !== "opening" && !figures.includes("no WebGPU")) {
    report({ figures, colours: texture ? await countColours() : {} });
  }
}).observe(document, { childList: true, subtree: true, characterData: true });
