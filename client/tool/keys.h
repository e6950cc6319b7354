/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_KEYS_H
#define UMBRAGE_TOOL_KEYS_H
/* Values that are keys with numbers: "eye=1,2,3,target=0,0,0,fov=60". */
#include <stdbool.h>
#include <stddef.h>
#include "umbrage/status.h"

struct umbu_key {
    const char *name;
    bool *given;    /* true: the text has the key; false before. */
    double *values; /* [count] */
    unsigned count;
    double limit; /* Largest magnitude of a value. */
};

/*
 * Reads a text of keys, in any order, each at most once.
 *
 * In:    option: name for errors, as "--camera". forms: forms of the keys, for errors.
 * Fails: E_ARGUMENT. Values before the error are set.
 */
UMB_CHECKED enum umb_status umbu_read_keys(const char *option, const char *text, const char *forms,
                                           const struct umbu_key *keys, size_t count,
                                           struct umb_error *error);

#endif
