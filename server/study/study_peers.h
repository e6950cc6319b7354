/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_PEERS_H
#define UMBRAGE_SERVER_STUDY_STUDY_PEERS_H
/*
 * Peers that answer the samples of a study (study.h), made from its open assets so that resolution
 * and frustum are the same. They are a plain 16-bit shadow map with percentage closer filtering
 * (shadow_map16.h), a NanoVDB mask grid of the voxels (nanovdb_peer.h, if the build has it), and
 * the maps that `umbrage derive` makes for GPUs.
 *
 * The map and the grid get an advantage: samples that face away are not part of their time, and the
 * others are moved off their surface and converted to floats before. An asset's time includes all
 * these steps.
 */
#include "study/nanovdb_peer.h"
#include "study/shadow_map16.h"
#include "study/study.h"
#include "umbrage/derive.h"

#define UMBT_PEERS_MAX         32
#define UMBT_PEER_DERIVED_TAPS 9 /* filter width of derived maps */

/* One peer of one bake. */
struct umbt_peer {
    enum umbt_study_method method;
    uint32_t bake; /* number of the bake whose voxels the peer has */
    uint64_t bytes;
    double build_s;              /* DERIVED: CPU time of umb_derive */
    enum umbt_map16_way way;     /* DEPTH_MAP */
    struct umbt_map16 map;       /* DEPTH_MAP */
    struct umbt_nanovdb *volume; /* NANOVDB */
    struct umb_derived *derived; /* DERIVED */
    const char *name;            /* "depth map", "nanovdb", "derived vsm"; static */
};

struct umbt_peers {
    uint32_t count;
    struct umbt_peer list[UMBT_PEERS_MAX];
    /* Samples that face the light or have no normal, in order. */
    size_t facing_count;
    uint32_t *rank;         /* [points + 1]: facing samples before each */
    double (*positions)[3]; /* [facing_count] */
    float (*normals)[3];    /* [facing_count] */
};

/*
 * Makes the peers at all resolutions that each of them supports. study->missing names the other
 * peers and the reason. Fails: E_NO_MEMORY, and the errors of umb_derive.
 */
UMB_CHECKED enum umb_status umbt_peers_make(struct umbt_study *study, struct umbt_peers *peers,
                                            struct umb_error *error);
void umbt_peers_finish(struct umbt_peers *peers);

/* Moves the facing samples off their surface for a filter of `taps`, relative to the asset's
 * origin. Returns float[3 * facing_count] for free(); NULL if out of memory. */
float *umbt_peers_moved(const struct umbt_study *study, const struct umbt_peers *peers,
                        const struct umbt_study_bake *bake, uint32_t taps);

#endif
