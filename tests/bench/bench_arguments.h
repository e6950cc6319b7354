/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_ARGUMENTS_H
#define UMBRAGE_TESTS_BENCH_ARGUMENTS_H
/*
 * Command lines of benchmark programs: options `--name VALUE` and `--help`. What a program does not
 * understand ends it with status 64 before it measures anything, naming what it was.
 */
#include <stdio.h>
#include "umbrage/status.h"

/*
 * Holds a command line against the options that a program takes. For --help, prints the usage on
 * stdout and ends the program with 0; for a word that is no option, or an option without its value,
 * ends it with 64. options: names with their hyphens, the last NULL.
 */
void bench_arguments(int argc, char **argv, const char *const *options, void (*usage)(FILE *to));

/* The value of an option `--name VALUE` on a command line, or `otherwise`. */
const char *bench_option(int argc, char **argv, const char *name, const char *otherwise);

/* The same of an option that takes one of `words`, the last NULL; ends the program on others. */
const char *bench_choice(int argc, char **argv, const char *name, const char *const *words,
                         const char *otherwise);

/* The value of --size, "quick" or "full". */
const char *bench_size(int argc, char **argv);

/* Ends the program with a message and status 64: the caller's mistake, not the product's. */
void bench_misuse(const char *format, ...) UMB_PRINTF(1, 2) __attribute__((noreturn));

#endif
