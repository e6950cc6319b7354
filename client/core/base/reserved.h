/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_RESERVED_H
#define UMBRAGE_CORE_BASE_RESERVED_H
/*
 * The check of `reserved` of public structs, words that later versions may use (umbrage/version.h).
 * A word that is not 0 is a setting that this version does not know, or the caller did not start
 * the struct with zeros, and a later version would misread it.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

/* Returns true, with E_ARGUMENT in error, if a word of object->reserved is not 0. In: name: name
 * of the struct in messages. */
#define UMB__UNKNOWN(object, name, error)                                                          \
    umb__unknown((object)->reserved, sizeof(object)->reserved / sizeof(uint64_t), name, error)

static inline bool umb__unknown(const uint64_t *words, size_t count, const char *name,
                                struct umb_error *error)
{
    for (size_t i = 0; i < count; i++) {
        if (words[i] != 0) {
            (void)umb_fail(error, UMB_E_ARGUMENT,
                           "%s.reserved[%zu]: %llu, must be 0: start the struct with zeros, or use "
                           "the later libumbrage that knows this setting",
                           name, i, (unsigned long long)words[i]);
            return true;
        }
    }
    return false;
}

#endif
