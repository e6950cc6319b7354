/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_STUDY_ARGS_H
#define UMBRAGE_SERVER_STUDY_STUDY_ARGS_H
/*
 * Command lines by table. Options are `--name VALUE`, `--name=VALUE` or a flag `--name`; `-h` is
 * `--help`; `--` ends them; all other arguments fill the table's words in turn. Every refusal names
 * the option, the value and the limit. Nothing is copied: texts point into argv.
 */
#include <stddef.h>
#include <stdint.h>
#include "umbrage/query.h"

enum umbt_option_kind {
    UMBT_FLAG = 0, /* int *, set to 1 */
    UMBT_COUNT,    /* uint64_t *, decimal, min..max */
    UMBT_TEXT,     /* const char ** */
    UMBT_WORD,     /* const char **, an argument without dashes; needed unless --help is given */
};

struct umbt_option {
    /* With its dashes; "-o" style names take a separate value only; of a word: its name in
     * --help. */
    const char *name;
    enum umbt_option_kind kind;
    void *value;
    uint64_t min, max; /* UMBT_COUNT */
};

/* Parses argv[0..argc-1]. Fails: E_ARGUMENT. */
UMB_CHECKED enum umb_status umbt_args_parse(int argc, char **argv,
                                            const struct umbt_option *options, size_t option_count,
                                            struct umb_error *error);

/*
 * Reads a finite number at *text and moves *text past it.
 *
 * Returns 1, or 0 (and leaves *text unchanged) if there is none.
 */
int umbt_number_read(const char **text, double *value);

/* Parses "1280x720": 1..16384 each, at most 64 Mi pixels. Fails: E_ARGUMENT. */
UMB_CHECKED enum umb_status umbt_size_parse(const char *text, uint32_t *width, uint32_t *height,
                                            struct umb_error *error);

/* Parses a bias: "auto", "none", "1.5vox" or "0.02m" (0..1e6) into settings. Fails: E_ARGUMENT. */
UMB_CHECKED enum umb_status umbt_bias_parse(const char *text, struct umb_query_settings *settings,
                                            struct umb_error *error);

/* Parses "y" or "z": *z_up becomes 0 or 1. Fails: E_ARGUMENT. */
UMB_CHECKED enum umb_status umbt_up_parse(const char *text, int *z_up, struct umb_error *error);

#endif
