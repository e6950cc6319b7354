/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_RESERVED_H
#define UMBRAGE_CORE_BASE_RESERVED_H
/*
 * The check of the words `reserved` of public structs, which later versions may use
 * (umbrage/version.h). A nonzero word is either a setting of a later version, or the caller did not
 * zero the struct and a later version would misread it.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "umbrage/status.h"

/* Returns true and sets error to E_ARGUMENT if a word of object->reserved is not 0. In: name: the
 * struct's name, for the message. */
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
