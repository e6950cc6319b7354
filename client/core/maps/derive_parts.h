/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_MAPS_DERIVE_PARTS_H
#define UMBRAGE_CORE_MAPS_DERIVE_PARTS_H
/* A struct umb_derived with its private parts. */
#include "umbrage/derive.h"

struct umb__derived {
    struct umb_derived shown; /* Public part; first, so that both have one address */
    struct umb_alloc own_alloc;
    const struct umb_alloc *alloc; /* &own_alloc; NULL: malloc */
    uint8_t *file; /* [file_size] KTX file, made at the first call of umb_derived_ktx2 */
    size_t file_size;
};

#endif
