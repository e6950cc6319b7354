/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_BENCH_ARGUMENTS_H
#define UMBRAGE_TESTS_BENCH_ARGUMENTS_H
/*
 * Command lines of benchmark programs: options `--name VALUE` and `--help`. An argument that a
 * program does not understand ends the program with status 64 before anything is measured; the
 * message names the argument.
 */
#include <stdio.h>
#include "umbrage/status.h"

/*
 * Checks a command line against the options that a program takes. For --help, prints the usage on
 * stdout and ends the program with 0; for a word that is no option, or an option without its value,
 * ends it with 64. options: names with their hyphens, the last NULL.
 */
void bench_arguments(int argc, char **argv, const char *const *options, void (*usage)(FILE *to));

/* Returns the value of an option `--name VALUE` on a command line, or `otherwise` if it is not
 * given. */
const char *bench_option(int argc, char **argv, const char *name, const char *otherwise);

/* Returns the value of an option whose value is one of `words`, the last of which is NULL. Ends the
 * program on any other value. */
const char *bench_choice(int argc, char **argv, const char *name, const char *const *words,
                         const char *otherwise);

/* The value of --size, "quick" or "full". */
const char *bench_size(int argc, char **argv);

/* Ends the program with a message and status 64: the fault is in the command line, not in the
 * product. */
void bench_misuse(const char *format, ...) UMB_PRINTF(1, 2) __attribute__((noreturn));

#endif
