/* SPDX-License-Identifier: Apache-2.0 */
/* See bench_arguments.h. */
#include "bench_arguments.h"

#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#define EXIT_MISUSE 64

void bench_misuse(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    (void)fputs("bench: ", stderr);
    (void)vfprintf(stderr, format, arguments);
    (void)fputs(" (--help says what there is)\n", stderr);
    va_end(arguments);
    exit(EXIT_MISUSE);
}

static int is_one_of(const char *word, const char *const *words)
{
    while (*words != NULL && strcmp(*words, word) != 0) {
        words++;
    }
    return *words != NULL;
}

void bench_arguments(int argc, char **argv, const char *const *options, void (*usage)(FILE *to))
{
    for (int i = 1; i < argc; i += 2) {
        if (strcmp(argv[i], "--help") == 0) {
            usage(stdout);
            exit(0);
        }
        if (!is_one_of(argv[i], options)) {
            bench_misuse("'%.40s' is not an option", argv[i]);
        }
        if (i + 1 == argc) {
            bench_misuse("%s: its value is missing", argv[i]);
        }
    }
}

const char *bench_option(int argc, char **argv, const char *name, const char *otherwise)
{
    const char *value = otherwise;
    for (int i = 1; i + 1 < argc; i += 2) {
        value = strcmp(argv[i], name) == 0 ? argv[i + 1] : value;
    }
    return value;
}

const char *bench_choice(int argc, char **argv, const char *name, const char *const *words,
                         const char *otherwise)
{
    const char *value = bench_option(argc, argv, name, otherwise);
    if (value != NULL && !is_one_of(value, words)) {
        bench_misuse("%s: '%.40s' is none of those that there are", name, value);
    }
    return value;
}

const char *bench_size(int argc, char **argv)
{
    static const char *const sizes[] = {"quick", "full", NULL};
    return bench_choice(argc, argv, "--size", sizes, "quick");
}
