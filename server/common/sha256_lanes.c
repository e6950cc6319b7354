/* SPDX-License-Identifier: Apache-2.0 */
/*
 * SHA-256 in lanes, see sha256_lanes.h. The library takes jobs and returns finished ones. It works
 * on one job in each lane, so messages of different lengths do not wait for one another.
 */
#include "common/sha256_lanes.h"

#ifdef HAVE_IPSEC_MB
#define NO_COMPAT_IMB_API_053 /* hides old names of the library, some of which OpenSSL has too */
#include <intel-ipsec-mb.h>
#include <string.h>

#include "base/memory.h"

#define ALIGNMENT ((size_t)64) /* alignment of the library's memory: a cache line */

struct umbs_sha256_lanes {
    const struct umb_alloc *alloc;
    IMB_MGR *manager; /* state of the library, inside this block */
};

struct umbs_sha256_lanes *umbs_sha256_lanes_create(const struct umb_alloc *alloc)
{
    struct umbs_sha256_lanes *lanes =
        umb__alloc_zeroed(alloc, sizeof *lanes + ALIGNMENT + imb_get_mb_mgr_size(), 1);
    if (lanes == NULL) {
        return NULL;
    }
    const uintptr_t after = (uintptr_t)(lanes + 1);
    uint8_t *memory = (uint8_t *)(lanes + 1) + (-after & (ALIGNMENT - 1));
    lanes->alloc = alloc;
    lanes->manager = imb_set_pointers_mb_mgr(memory, 0, 1);
    if (lanes->manager != NULL) {
        init_mb_mgr_auto(lanes->manager, NULL);
    }
    if (lanes->manager == NULL || imb_get_errno(lanes->manager) != 0) {
        umb__free(alloc, lanes);
        return NULL;
    }
    return lanes;
}

/* 1 if a returned job is done. NULL: no job was returned. */
static size_t is_done(const IMB_JOB *job)
{
    return job != NULL && job->status == IMB_STATUS_COMPLETED;
}

bool umbs_sha256_lanes_digest(struct umbs_sha256_lanes *lanes, const uint8_t *const *messages,
                              const size_t *sizes, size_t count, uint8_t (*digests)[UMB_ID_BYTES])
{
    IMB_MGR *manager = lanes->manager;
    IMB_JOB *job;
    size_t wanted = 0, done = 0;
    for (size_t i = 0; i < count; i++) {
        if (sizes[i] > UMBS_SHA256_LANES_LONGEST) {
            continue;
        }
        wanted++;
        job = IMB_GET_NEXT_JOB(manager);
        memset(job, 0, sizeof *job);
        job->cipher_mode = IMB_CIPHER_NULL;
        job->cipher_direction = IMB_DIR_ENCRYPT;
        job->chain_order = IMB_ORDER_HASH_CIPHER;
        job->hash_alg = IMB_AUTH_SHA_256;
        job->src = messages[i];
        job->msg_len_to_hash_in_bytes = sizes[i];
        job->auth_tag_output = digests[i];
        job->auth_tag_output_len_in_bytes = UMB_ID_BYTES;
        done += is_done(IMB_SUBMIT_JOB(manager));
    }
    while ((job = IMB_FLUSH_JOB(manager)) != NULL) {
        done += is_done(job);
    }
    return done == wanted;
}

void umbs_sha256_lanes_destroy(struct umbs_sha256_lanes *lanes)
{
    if (lanes != NULL) {
        umb__free(lanes->alloc, lanes);
    }
}

#else

struct umbs_sha256_lanes *umbs_sha256_lanes_create(const struct umb_alloc *alloc)
{
    (void)alloc;
    return NULL;
}

bool umbs_sha256_lanes_digest(struct umbs_sha256_lanes *lanes, const uint8_t *const *messages,
                              const size_t *sizes, size_t count, uint8_t (*digests)[UMB_ID_BYTES])
{
    (void)lanes, (void)messages, (void)sizes, (void)digests;
    return count == 0;
}

void umbs_sha256_lanes_destroy(struct umbs_sha256_lanes *lanes)
{
    (void)lanes;
}

#endif
