// SPDX-License-Identifier: Apache-2.0
/**
 * Shadow queries on umbrage assets in browsers, workers and node.
 *
 *     const asset = await umbrage.open("https://host/city.umb", { id });
 *     await asset.want({ camera: { eye: [1, 1.7, 1], target: [100, 1.7, 9], fov_y: 1 } });
 *     const { values, exact } = await asset.query(points, { taps: 9 });
 *
 * Lengths are metres, angles radians, points x y z in world space. Settings have the names of
 * struct umb_query_settings and struct umb_partial_view (umbrage/query.h, umbrage/partial.h).
 * Failures are UmbrageError.
 */

export type Triple = readonly [number, number, number];

/** Bytes of a packed file (.umb). */
export interface Source {
  /** Reads a byte range; shorter only at the end of the file. */
  read(offset: number, length: number, signal?: AbortSignal): Promise<Uint8Array>;
  /** Number of reads at a time; 1 by default. */
  parallel?: number;
  close?(): unknown;
}

export interface OpenOptions {
  /** Id that the asset must have, 64 hexadecimal digits; without it the server chooses the asset. */
  id?: string;
  /** Most bytes for pages, their layout and working memory; 256 MiB by default. Pages that matter least are dropped. */
  memory?: number;
  /** HTTP headers, such as Authorization. */
  headers?: Record<string, string>;
  /**
   * true: each range has an address of its own, by `?from=` and its offset. Use it for servers that ignore queries:
   * browsers ask for cacheable ranges of one address one after the other.
   */
  apart?: boolean;
  /**
   * Most bytes of a file that is taken whole from a server without byte ranges, which must tell its length; 0, the default,
   * refuses such servers.
   */
  whole_bytes?: number;
  signal?: AbortSignal;
  /** The module or its address, where a bundler moves files; by default umbrage.wasm beside the package's files. */
  wasm?: WebAssembly.Module | string | URL;
}

export interface Camera {
  eye: Triple;
  /** Point that the camera looks at; or `forward`. */
  target?: Triple;
  forward?: Triple;
  /** Upward direction; 0, 1, 0 by default. */
  up?: Triple;
  /** Angle of the picture's height. */
  fov_y: number;
  /** Width of the picture divided by its height; 1 by default. */
  aspect?: number;
  /** Distance from the eye; 0, the default: no limit. */
  far_m?: number;
}

/** Points that later queries ask about, and how exactly. Without box and camera: all. */
export interface View {
  /** Number or name of a light; all lights by default. */
  light?: number | string;
  /** Lowest and highest corner. */
  box?: readonly [Triple, Triple];
  camera?: Camera;
  /** Edge of cells that need no finer pages; 0: exact. */
  max_error_m?: number;
  /** Angle at the eye of cells that need no finer pages; 0: exact. */
  max_error_rad?: number;
  /** Widest window of later queries; 17 by default. */
  taps?: number;
  /** Length by which the longest bias of later queries exceeds the automatic one. */
  bias_m?: number;
}

export interface WantOptions {
  /** Bytes to read before it stops; 0: no limit. */
  max_bytes?: number;
  /** Bytes of a round, about; 0: a quarter of the bytes held, at least 512 KiB. */
  round_bytes?: number;
  signal?: AbortSignal;
  /** Called after each round; a true result stops. */
  progress?(held: Held): unknown;
}

/** The part of an asset that is held, and the cost of fetching it. */
export interface Held {
  pages: number;
  pages_held: number;
  asset_bytes: number;
  held_bytes: number;
  memory_bytes: number;
  memory_peak_bytes: number;
  pages_dropped: number;
  builds: number;
  blocks: number;
  blocks_held: number;
  received_bytes: number;
  requests: number;
  rounds: number;
  pages_received: number;
  /** Bytes of the WebAssembly memory. */
  module_bytes: number;
}

export type Format = "f32" | "u8" | "bit";

export interface QuerySettings {
  /** Number or name of a light; 0 by default. */
  light?: number | string;
  /** Width of the window in texels: odd, 1 to 17. */
  taps?: number;
  filter?: "box" | "tent" | "gaussian" | "penumbra" | "footprint";
  /** "auto", "none", or a length in bias_unit. */
  bias?: "auto" | "none" | number;
  bias_unit?: "metres" | "voxels";
  format?: Format;
  footprint_m?: number;
  level?: number;
  light_extent?: number;
  opaque_only?: boolean;
  eye?: Triple;
  pixel_rad?: number;
  /** Added to every point. */
  origin?: Triple;
  /** A normal for each point, of any length. */
  normals?: Float32Array;
  /** Width of the footprint of each point. */
  footprints?: Float32Array;
  /** false: pages that inexact points need are not noted for `want()` without a view. */
  want?: boolean;
  /** true: the answers have low, high and error_m. */
  bounds?: boolean;
}

export interface Answers<Values = Float32Array> {
  /** Share of light, 0 shadowed to 1 lit: floats, bytes 0 to 255, or bits (point i is bit i % 8 of byte i / 8). */
  values: Values;
  /** 1 where the answer is that of the whole asset, bit for bit. */
  exact: Uint8Array;
  exact_count: number;
  /** An answer is true, or a true shadow boundary is at most this far from the point; 0: no bound is stated. */
  bound: number;
  /** Widest edge of the missing cubes; 0 where all is exact. */
  worst_error_m: number;
  /** With `bounds`: limits of the whole asset's answer, and edges of the missing cubes. */
  low?: Float32Array;
  high?: Float32Array;
  error_m?: Float32Array;
  stats: Record<"points" | "outside" | "before" | "behind" | "facing_away" | "undefined" | "nodes" | "bricks", number>;
}

/** How an answer comes about: struct umb_explanation of umbrage/query.h. */
export interface Explanation {
  answer: number;
  lit_taps: number;
  taps: number;
  level: number;
  frustum: number;
  nodes: number;
  bricks: number;
  transmittance: number;
  bias_m: number;
  cosine: number;
  voxel_size_m: number;
  footprint_m: number;
  facing_away: boolean;
  undefined: boolean;
  outside: boolean;
  before: boolean;
  behind: boolean;
  has_normal: boolean;
  moved: number[];
  voxel: number[];
  cell: number[];
  window: number[];
  /** Bit i of row j: texel (window[0] + i, window[1] + j) is lit. */
  rows: number[];
  steps: { level: number; state: "shadowed" | "lit" | "mixed"; index: number }[];
}

export interface Light {
  name: string;
  kind: "directional" | "spot" | "point" | "rectangle" | "disc" | "unknown";
  direction: number[];
  position: number[];
  extent: number;
  /** Voxels a side of its first frustum. */
  voxels: number;
  frusta: number;
}

export interface Info {
  id: string;
  lights: Light[];
  origin: number[];
  /** Lowest and highest corner of the casters' box. */
  bounds: [number[], number[]];
}

/** Entries of 16 bytes that changed for a GPU; gpu.d.ts takes them. It may be posted to another thread. */
export interface Changes {
  /** Entries of the whole array. */
  capacity: number;
  /** Pairs of first entry and count. */
  ranges: Uint32Array;
  /** The entries of all ranges. */
  words: Uint32Array;
}

export interface PlacementOptions {
  /** Number or name of a light; 0 by default. */
  light?: number | string;
  /** Face of a light that is not directional: below its `frusta`. */
  face?: number;
  /** World position of the shader's position 0, 0, 0. */
  origin?: Triple;
  /** Instead of `origin`: a rotation and a move to the world, column major, such as a camera's matrix. */
  to_world?: ArrayLike<number>;
  bias?: "auto" | "none" | number;
  bias_unit?: "metres" | "voxels";
}

/** Transform from a shader's positions to the voxels of a light: struct UmbragePlacement. */
export interface Placement {
  bytes: ArrayBuffer;
  /** Its members, as views of `bytes`. */
  fields: Record<"row_x" | "row_y" | "row_z" | "row_w" | "info", Int32Array> & Record<"low", Uint32Array> &
    Record<"step_x" | "step_y" | "step_z" | "light" | "lamp" | "axis", Float32Array>;
  /** Positions with a coordinate beyond it count as lit. */
  range_m: number;
  /** Positions farther than this from a voxel's border get the voxel that `query` looks up; on x and y, and in depth. */
  bound_voxels: number;
  bound_depth: number;
}

/** An open asset. Calls may overlap: `want` calls run one after the other, queries use the pages
 * held at that moment. */
export class Asset {
  readonly info: Info;
  /** Fetches the pages that views need; without a view those that queries missed. Each page is proven. */
  want(views?: View | readonly View[], options?: WantOptions): Promise<Held>;
  /** Answers points: three numbers a point. Many points are answered in turns, so that a page stays responsive. */
  query(points: Float32Array | Float64Array, settings?: QuerySettings & { format?: "f32" }): Promise<Answers>;
  query(points: Float32Array | Float64Array, settings: QuerySettings & { format: "u8" | "bit" }):
    Promise<Answers<Uint8Array>>;
  /** Explains the answer of one point from the pages that are held; voxels of missing pages count
   * as shadowed. */
  explain(point: Triple, settings?: Omit<QuerySettings, "normals"> & { normal?: Triple }): Explanation;
  held(): Held;
  /** Entries for a GPU that changed since the last call; the first call returns all. For one copy
   * of the entries only. */
  changes(): Changes;
  placement(options?: PlacementOptions): Placement;
  /** Frees the asset. */
  close(): Promise<void>;
}

export class UmbrageError extends Error {
  /** Name of a status of umbrage/status.h, such as "E_CORRUPT". */
  readonly code: string;
}

/**
 * Opens an asset: reads its head and its coarse pages.
 *
 * @param where an address (in node also a file's path), a Blob or File, bytes, or a source
 */
export function open(where: string | URL | Blob | ArrayBuffer | Uint8Array | Source, options?: OpenOptions):
  Promise<Asset>;
