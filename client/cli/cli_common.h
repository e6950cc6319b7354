/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_COMMON_H
#define UMBRAGE_CLI_CLI_COMMON_H
/*
 * What the sub-commands share: their settings, talk on stderr.
 *
 * Every sub-command is one function `int umbc_NAME(argc, argv)` that returns the exit code; argv[0]
 * is the sub-command's name. stdout is data, stderr is talk.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include "tool/session.h"

#define UMBC_EXIT_NEGATIVE 1 /* the command worked and the answer is no */
#define UMBC_EXIT_USAGE    2
#define UMBC_EXIT_DATA     65
#define UMBC_EXIT_MISSING  69

/* Settings that most commands have. */
struct umbc_settings {
    const char *target; /* The argument: a file, an asset, a job */
    struct umbu_session session;
    bool json, quiet;
};

/* Row of the argument. type: the command's settings. */
#define UMBC_TARGET_ROW(type, name, help)                                                          \
    name, NULL, help, UMBU_TEXT, UMBU_AT(type, target), .needed = true

/* Prints "umbrage: message" on stderr and returns the exit code of the error's status. */
int umbc_complain(const struct umb_error *error);

/* The same for an error about a file, which is named, and whose content is never a usage error: 2
 * becomes 65. */
int umbc_complain_file(const char *path, const struct umb_error *error);

/* The same with a message made here; exit code of status. */
int umbc_complain_as(enum umb_status status, const char *format, ...) UMB_PRINTF(2, 3);

/* Prints "umbrage COMMAND: message" and returns 2. command: NULL for none. */
int umbc_usage_error(const char *command, const char *format, ...) UMB_PRINTF(2, 3);

/* A reader of options: 64 hexadecimal digits into uint8[UMB_ID_BYTES]. */
enum umb_status umbc_read_id(const struct umbu_option *option, const char *text, void *field,
                             struct umb_error *error);
#define UMBC_ID UMBU_READ(umbc_read_id, "an id of 64 hexadecimal digits")

/*
 * True if an argument means a file: it exists as one, ends in .umb or .umbm, begins with '/' or
 * '.', or cannot be an asset's name, which is NAME or FOLDER/NAME of [A-Za-z0-9._-].
 */
bool umbc_is_file(const char *word);

/* Opens a file to be read, which messages name. Fails: E_NO_INPUT if there is none or it is a
 * folder, else as open does. */
UMB_CHECKED enum umb_status umbc_open_input(const char *path, FILE **file, struct umb_error *error);

/* Flushes stdout; returns code, or 74 with a message if anything could not be written. */
int umbc_finish_stdout(int code);

/* Writes text from a file or a daemon for people: control characters, with which it could command
 * the terminal, become blanks, malformed UTF-8 '?'. */
void umbc_print_text(FILE *file, const char *text, size_t length);

/* "1.5 GiB", "12 B". */
void umbc_format_bytes(unsigned long long bytes, char text[32]);

int umbc_info(int argc, char **argv);
int umbc_query(int argc, char **argv);
int umbc_list(int argc, char **argv);
int umbc_load(int argc, char **argv);
int umbc_submit(int argc, char **argv);
int umbc_watch(int argc, char **argv);
int umbc_jobs(int argc, char **argv);
int umbc_cancel(int argc, char **argv);
int umbc_fetch(int argc, char **argv);
int umbc_rm(int argc, char **argv);
int umbc_verify(int argc, char **argv);
int umbc_paging(int argc, char **argv);
int umbc_derive(int argc, char **argv);
int umbc_frames(int argc, char **argv);
int umbc_pack(int argc, char **argv);
int umbc_unpack(int argc, char **argv);

/*
 * Replaces this process by a program that lies beside it.
 *
 * In: program: "umbrage-bake". word: put before the arguments, or NULL. arguments: NULL-terminated.
 *     command: what was typed, for the message.
 * Returns only if that failed: 69 with a sentence if the program is missing.
 */
int umbc_start_program(const char *command, const char *program, const char *word,
                       char **arguments);

#endif
