/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Command lines by table, and the small value formats of the study's options.
 *
 * Numbers are read by strtod and strtoull under the "C" locale: the program never calls setlocale.
 */
#include "study/study_args.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SIDE_MAX   16384.0
#define PIXELS_MAX 67108864.0 /* 64 Mi: 192 MiB a picture */
#define BIAS_MAX   1e6        /* as umb_query_settings.bias */

static enum umb_status count_parse(const char *text, const struct umbt_option *option,
                                   struct umb_error *error)
{
    char *end = NULL;
    errno = 0;
    const unsigned long long value = strtoull(text, &end, 10);
    if (text[0] < '0' || text[0] > '9' || *end != '\0' || errno != 0 || value < option->min ||
        value > option->max) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "%s: '%.60s' is not a whole number from %llu to %llu", option->name, text,
                        (unsigned long long)option->min, (unsigned long long)option->max);
    }
    *(uint64_t *)option->value = value;
    return UMB_OK;
}

/* The table's entry for an argument; *inline_value becomes the text behind '=' or NULL. */
static const struct umbt_option *option_find(const char *argument,
                                             const struct umbt_option *options, size_t option_count,
                                             const char **inline_value)
{
    const char *equals = argument[1] == '-' ? strchr(argument, '=') : NULL;
    const size_t length = equals != NULL ? (size_t)(equals - argument) : strlen(argument);
    *inline_value = equals != NULL ? equals + 1 : NULL;
    for (size_t i = 0; i < option_count; i++) {
        if (strlen(options[i].name) == length && memcmp(options[i].name, argument, length) == 0) {
            return &options[i];
        }
    }
    return NULL;
}

static enum umb_status option_set(const struct umbt_option *option, const char *text,
                                  struct umb_error *error)
{
    if (text == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: needs a value", option->name);
    }
    if (option->kind == UMBT_COUNT) {
        return count_parse(text, option, error);
    }
    *(const char **)option->value = text;
    return UMB_OK;
}

/* Stores an argument that is not an option as the first unset word. */
static enum umb_status word_set(const char *text, const struct umbt_option *options,
                                size_t option_count, struct umb_error *error)
{
    size_t words = 0;
    for (size_t i = 0; i < option_count; i++) {
        if (options[i].kind == UMBT_WORD) {
            const char **value = options[i].value;
            if (*value == NULL) {
                *value = text;
                return UMB_OK;
            }
            words++;
        }
    }
    return umb_fail(error, UMB_E_ARGUMENT,
                    "argument '%.80s': at most %zu arguments besides the options are taken", text,
                    words);
}

/* Checks that every word is set, unless --help is. */
static enum umb_status words_check(const struct umbt_option *options, size_t option_count,
                                   struct umb_error *error)
{
    const struct umbt_option *missing = NULL;
    for (size_t i = 0; i < option_count; i++) {
        if (strcmp(options[i].name, "--help") == 0 && *(const int *)options[i].value) {
            return UMB_OK;
        }
        if (options[i].kind == UMBT_WORD && *(const char **)options[i].value == NULL &&
            missing == NULL) {
            missing = &options[i];
        }
    }
    return missing == NULL
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT, "%s: is needed; see --help", missing->name);
}

/* The long name of a flag's letter. */
static const char *name_of(const char *word)
{
    return strcmp(word, "-h") == 0 ? "--help" : strcmp(word, "-q") == 0 ? "--quiet" : word;
}

enum umb_status umbt_args_parse(int argc, char **argv, const struct umbt_option *options,
                                size_t option_count, struct umb_error *error)
{
    int options_over = 0;
    for (int i = 0; i < argc; i++) {
        enum umb_status status = UMB_OK;
        if (options_over || argv[i][0] != '-' || argv[i][1] == '\0') {
            status = word_set(argv[i], options, option_count, error);
        } else if (strcmp(argv[i], "--") == 0) {
            options_over = 1;
        } else {
            const char *text = NULL, *name = name_of(argv[i]);
            const struct umbt_option *option = option_find(name, options, option_count, &text);
            if (option == NULL) {
                return umb_fail(error, UMB_E_ARGUMENT, "option '%.80s' is not known; see --help",
                                argv[i]);
            }
            if (option->kind == UMBT_FLAG) {
                if (text != NULL) {
                    return umb_fail(error, UMB_E_ARGUMENT, "%s: takes no value", option->name);
                }
                *(int *)option->value = 1;
                continue;
            }
            if (text == NULL && i + 1 < argc) {
                text = argv[++i];
            }
            status = option_set(option, text, error);
        }
        if (status != UMB_OK) {
            return status;
        }
    }
    return words_check(options, option_count, error);
}

int umbt_number_read(const char **text, double *value)
{
    const char first = **text;
    if ((first < '0' || first > '9') && first != '-' && first != '+' && first != '.') {
        return 0; /* strtod would also skip spaces and read "inf" and "nan" */
    }
    char *end = NULL;
    const double number = strtod(*text, &end);
    const size_t length = (size_t)(end - *text);
    if (length == 0 || !isfinite(number) || memchr(*text, 'x', length) != NULL ||
        memchr(*text, 'X', length) != NULL) { /* strtod reads 0x10 as 16 */
        return 0;
    }
    *text = end;
    *value = number;
    return 1;
}

enum umb_status umbt_size_parse(const char *text, uint32_t *width, uint32_t *height,
                                struct umb_error *error)
{
    const char *at = text;
    double w = 0.0, h = 0.0;
    if (!umbt_number_read(&at, &w) || *at++ != 'x' || !umbt_number_read(&at, &h) || *at != '\0' ||
        w != floor(w) || h != floor(h) || w < 1.0 || h < 1.0 || w > SIDE_MAX || h > SIDE_MAX ||
        w * h > PIXELS_MAX) {
        return umb_fail(
            error, UMB_E_ARGUMENT,
            "--size: '%.60s' is not WIDTHxHEIGHT with 1 to 16384 pixels a side and at most "
            "67108864 pixels",
            text);
    }
    *width = (uint32_t)w;
    *height = (uint32_t)h;
    return UMB_OK;
}

enum umb_status umbt_bias_parse(const char *text, struct umb_query_settings *settings,
                                struct umb_error *error)
{
    const char *at = text;
    double value = 0.0;
    if (strcmp(text, "auto") == 0) {
        settings->bias_mode = UMB_BIAS_AUTO;
        return UMB_OK;
    }
    if (strcmp(text, "none") == 0) {
        settings->bias_mode = UMB_BIAS_NONE;
        return UMB_OK;
    }
    if (umbt_number_read(&at, &value) && value >= 0.0 && value <= BIAS_MAX &&
        (strcmp(at, "vox") == 0 || strcmp(at, "m") == 0)) {
        settings->bias_mode = *at == 'v' ? UMB_BIAS_VOXELS : UMB_BIAS_METRES;
        settings->bias = value;
        return UMB_OK;
    }
    return umb_fail(
        error, UMB_E_ARGUMENT,
        "--bias: '%.60s' is not auto, none, or a number from 0 to 1e6 with the unit vox or m "
        "(as 1.5vox, 0.02m)",
        text);
}

enum umb_status umbt_up_parse(const char *text, int *z_up, struct umb_error *error)
{
    if (strcmp(text, "y") != 0 && strcmp(text, "z") != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "--up: '%.60s' is neither y nor z", text);
    }
    *z_up = text[0] == 'z';
    return UMB_OK;
}
