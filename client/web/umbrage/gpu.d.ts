// SPDX-License-Identifier: Apache-2.0
/**
 * Shadows in shaders of WebGL2 and WebGPU.
 *
 *     const nodes = new gpu.WebGLNodes(gl);
 *     nodes.apply(asset.changes());                      // after each want()
 *     const sun = asset.placement({ light: "sun" });
 *     gpu.setPlacement(gl, program, "umbrage_sun", sun); // uniform UmbragePlacement umbrage_sun;
 *
 * The shader has gpu.glsl in front, and calls umbrage_box(umbrage_sun, position, normal, 9).
 */
import type { Changes, Placement } from "./index.js";

/** GLSL ES 3.00: goes behind `#version 300 es` and the precisions, which must be highp. */
export const glsl: string;
/** WGSL, with the buffer at group 0, binding 0. */
export const wgsl: string;
/** WGSL with the buffer elsewhere. */
export function wgslAt(group: number, binding: number): string;

export class WebGLNodes {
  constructor(gl: WebGL2RenderingContext);
  /** The texture `umbrage_data`: RGBA32UI. apply() may replace it. */
  readonly texture: WebGLTexture | null;
  readonly bytes_sent: number;
  /** Copies changed entries. Pass every result of one asset's changes(), in order. */
  apply(changes: Changes): void;
  dispose(): void;
}

export class WebGPUNodes {
  /** @param device a GPUDevice */
  constructor(device: any);
  /** The GPUBuffer `umbrage_data`. apply() may replace it. */
  readonly buffer: any;
  readonly bytes_sent: number;
  apply(changes: Changes): void;
  dispose(): void;
}

/** Sets a uniform of type UmbragePlacement of the program in use. */
export function setPlacement(gl: WebGL2RenderingContext, program: WebGLProgram, name: string, placement: Placement): void;
