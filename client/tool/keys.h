/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_KEYS_H
#define UMBRAGE_TOOL_KEYS_H
/* Values that are keys with numbers: "eye=1,2,3,target=0,0,0,fov=60". */
#include <stdbool.h>
#include <stddef.h>
#include "umbrage/status.h"

struct umbu_key {
    const char *name;
    bool *given;    /* Set if the key is there; false before. */
    double *values; /* [count] */
    unsigned count;
    double limit; /* Largest magnitude of a value. */
};

/*
 * Reads a text of keys, in any order, each at most once.
 *
 * In:    option: named in errors, as "--camera". forms: what the keys look like, for errors.
 * Fails: E_ARGUMENT. Values that were read until then are set.
 */
UMB_CHECKED enum umb_status umbu_read_keys(const char *option, const char *text, const char *forms,
                                           const struct umbu_key *keys, size_t count,
                                           struct umb_error *error);

#endif
