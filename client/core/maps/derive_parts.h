/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_DERIVE_PARTS_H
#define UMBRAGE_CORE_MAPS_DERIVE_PARTS_H
/* A struct umb_derived with its private parts, and the contrasts of its cascades. */
#include "maps/map_view.h"

struct umb__derived {
    struct umb_derived shown; /* Public part; first, so that both have one address */
    struct umb_alloc own_alloc;
    const struct umb_alloc *alloc; /* &own_alloc; NULL: malloc */
    uint8_t *file; /* [file_size] KTX file, made at the first call of umb_derived_ktx2 */
    size_t file_size;
    double contrast[UMB_CASCADES_MAX]; /* Contrast of each map */
};

/* Returns the bytes that umb__derive_contrasts holds while it runs. */
size_t umb__derive_seam_bytes(const struct umb_derive_settings *settings);

/*
 * Sets the contrast of each map. With match_contrast, the contrast of each cascade after the first
 * is found at up to UMB__SEAM_POINTS points of the view at the split before it.
 *
 * In:    whole: with its maps built. view: of the cascades; not read without match_contrast. box:
 *        of the asset.
 * Fails: E_NO_MEMORY; as umb_map_prepare.
 */
UMB_CHECKED enum umb_status umb__derive_contrasts(struct umb__derived *whole,
                                                  const struct umb__map_view *view,
                                                  const struct umb_box *box,
                                                  struct umb_error *error);

#endif
