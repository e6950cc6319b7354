/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_DERIVE_PARTS_H
#define UMBRAGE_CORE_MAPS_DERIVE_PARTS_H
/* What a struct umb_derived holds besides its public part. */
#include <stdbool.h>
#include "umbrage/derive.h"

struct umb__derived {
    struct umb_derived shown; /* the first, so that both have one address */
    struct umb_alloc alloc;
    bool own_alloc; /* false: malloc */
    uint8_t *file;  /* [file_size], once it was asked for */
    size_t file_size;
};

static inline const struct umb_alloc *umb__derived_alloc(const struct umb__derived *derived)
{
    return derived->own_alloc ? &derived->alloc : NULL;
}

#endif
