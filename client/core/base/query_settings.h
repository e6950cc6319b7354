/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_QUERY_SETTINGS_H
#define UMBRAGE_CORE_BASE_QUERY_SETTINGS_H
/*
 * The settings of a query: a row for each member of struct umb_query_settings.
 *
 * From a row follow the check of its range (query/settings.c), its field of QueryRequest, found by
 * its name (proto/wire/query_codec.c), the option of each program that takes it (tool/options.h),
 * and its line in docs/reference/api.md. Rules between settings stand with the code that obeys
 * them.
 */
#include <stddef.h>

enum umb__setting_kind {
    UMB__SETTING_COUNT,   /* uint32_t */
    UMB__SETTING_ODD,     /* uint32_t, an odd number; 0: unset */
    UMB__SETTING_CHOICE,  /* A value of an enum */
    UMB__SETTING_FLAG,    /* int, 0 or 1 */
    UMB__SETTING_NUMBER,  /* double, not below 0; 0: unset */
    UMB__SETTING_NUMBERS, /* double[3] */
};

struct umb__setting {
    const char *name; /* Name of the member, and of the field of QueryRequest */
    size_t at;        /* Offset in bytes in struct umb_query_settings */
    enum umb__setting_kind kind;
    double most;       /* Largest value; 0: the limit depends on the asset or the filter */
    const char *help;  /* One phrase: what it sets and its unit; no full stop */
    const char *unit;  /* Unit behind a number in errors, " rad"; NULL: none */
    size_t taken_by;   /* Offset in bytes in struct umb_filter_info of the flag of filters that take
                         the setting; 0: all filters take it */
    const char *words; /* Names of the values of a choice, "a|b"; NULL: none */
};

extern const struct umb__setting umb__settings[];
extern const size_t umb__setting_count;

#endif
