// SPDX-License-Identifier: Apache-2.0
/** Shadows of an asset in three.js: docs/guide/web.md. The package does not depend on three; THREE is an argument. */
import type { Asset, WantOptions } from "./index.js";

export interface ShadowSettings {
  /** Numbers or names of the asset's lights, at most 16; [0] by default. */
  lights?: (number | string)[];
  /** Width of the window in texels: odd, 1 to 17; 9 by default. */
  taps?: number;
  /** The shader answers box and tent of suns and box of one lamp; the rest is answered by answer(). */
  filter?: "box" | "tent" | "gaussian" | "penumbra";
  /** "auto", "none" or metres. */
  bias?: "auto" | "none" | number;
  /** "exact": stripes where pages are missing; "bound": also dots where a boundary crosses the window; "state" and "share": for counting. */
  overlay?: "none" | "exact" | "bound" | "state" | "share";
}

export interface LightSettings {
  color?: number;
  intensity?: number;
  /** Distance in metres beyond which lamps give no light; 0: no limit. */
  reach?: number;
}

/** Shadows of one asset for the materials of one WebGLRenderer (WebGL2). */
export class Shadows {
  constructor(THREE: object, renderer: object, asset: Asset, settings?: ShadowSettings);
  /** Extends a material, or the materials of an object and its descendants. */
  add(target: object): this;
  set(settings: ShadowSettings): void;
  readonly settings: Required<ShadowSettings>;
  readonly bytesSent: number;
  /** Call it before each render. changed: false if no pages came since the last call. */
  update(camera: object, options?: { changed?: boolean }): void;
  /** True if the shader answers; else call answer() after each move of the camera. */
  readonly byShader: boolean;
  /** Answers the picture by the core, in width x height pixels; the next render shows the answers. */
  answer(scene: object, camera: object, width: number, height: number): Promise<void>;
  /** Fetches the pages for the points that the camera sees, in width x height pixels. */
  want(scene: object, camera: object, width: number, height: number, fetching?: WantOptions): Promise<void>;
  /** Lights of three at the places of the asset's. */
  makeLights(settings?: LightSettings): object[];
}
