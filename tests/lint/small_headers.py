#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Small headers with a single user in the product belong into that user's module. KEPT lists those that stay, each
with the idea that its source file holds alone. Prints new ones, and lines of KEPT that nothing needs any more.
"""
import os
import re
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
LINES = 40  # a header below this is small
KEPT = {
    "client/cli/cli_http.h": "ranges of a file from a web server; the only user of curl",
    "client/core/format/page_compress.h": "compression, which a build for the web leaves out",
    "client/cli/cli_view_server.h": "a web server for one user; sockets and threads",
    "client/load/load_histogram.h": "latencies in buckets; tested alone",
    "client/load/load_metrics.h": "reads the daemon's metrics during a load test",
    "client/web/module/web_sha256.h": "SHA-256; tested alone",
    "client/web/module/zstd_frame.h": "the zstd decoder; tested alone",
    "client/web/module/zstd_literals.h": "literals and their Huffman code",
    "server/bake/analysis/sun_position.h": "astronomy; tested alone",
    "server/bake/bake_report.h": "what a bake prints",
    "server/bake/bake_run.h": "the bake, called by its main",
    "server/bake/build/tile_occluder_depth.h": "the effect's part of a tile; tested alone",
    "server/bake/shut_in.h": "from the options of a bake to the paths of its sandbox",
    "server/bake/write/curve_points.h": "points of the accuracy curve",
    "server/bake/write/octree_part.h": "the tiles of an octree that a self-check reads; tested alone",
    "server/bake/write/near_casters.h": "casters that the rays of some squares can meet",
    "server/bake/write/square_content.h": "digest of a square's voxels in an opened asset",
    "server/bake/write/squares_check.h": "the part of the self-check that uses records",
    "server/scene/alpha_pyramid.h": "ranges of alpha over blocks of texels; tested alone",
    "server/scene/parts_nest.h": "parts inside parts; tested alone",
    "server/scene/parts_weld.h": "corners of equal place",
    "server/study/deep_rays.h": "transmittance by rays, without a map",
    "server/study/technique_seams.h": "seams between cascades, and their contrasts",
    "server/study/frame_casters.h": "the part of a scene that a fitted camera shows",
    "server/study/picture_text.h": "labels in pictures; tested alone",
    "server/study/verify_bounds.h": "test of the bounds that a curve states",
    "server/store/fault_guard.h": "reads of a mapped file that may fail; tested alone",
}


def main():
    words = ["git", "-C", ROOT, "ls-files", "client", "proto", "server"]
    names = subprocess.run(words, stdout=subprocess.PIPE, check=True, text=True).stdout.split()
    texts = {}
    for name in names:
        if name.endswith((".c", ".h", ".cc")) and os.path.isfile(os.path.join(ROOT, name)):
            with open(os.path.join(ROOT, name), encoding="utf-8") as file:
                texts[name] = file.read()
    users = {}
    for name, text in texts.items():
        for base in set(re.findall(r'#\s*include\s+"(?:[^"]*/)?([^"/]+\.h)"', text)):
            users.setdefault(base, set()).add(name)
    small = {name for name, text in texts.items()
             if name.endswith(".h") and not name.startswith("client/include/") and text.count("\n") < LINES
             and len(users.get(os.path.basename(name), set()) - {name[:-2] + ".c"}) <= 1}
    for name in sorted(small - set(KEPT)):
        print(f"{name}: under {LINES} lines, with a single user: fold it, or say in tests/lint/small_headers.py why not")
    for name in sorted(set(KEPT) - small):
        print(f"{name}: tests/lint/small_headers.py keeps it, and need not")


if __name__ == "__main__":
    sys.exit(main())
