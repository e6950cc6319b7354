/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_COMMON_H
#define UMBRAGE_CLI_CLI_COMMON_H
/*
 * What the sub-commands share: settings, messages, names of files and assets.
 *
 * Every sub-command is one function `int umbc_NAME(argc, argv)` that returns the exit code; argv[0]
 * is the sub-command's name. Data goes to stdout, messages to stderr.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include "tool/json.h"
#include "tool/session.h"

#define UMBC_EXIT_NEGATIVE 1 /* the command worked, and its answer is no */
#define UMBC_EXIT_USAGE    2
#define UMBC_EXIT_DATA     65
#define UMBC_EXIT_MISSING  69

/* Settings that most commands have. */
struct umbc_settings {
    const char *target; /* Argument of the command: a file, an asset or a job */
    struct umbu_session session;
    bool json, quiet;
};

/* Row of the argument. type: the command's settings. */
#define UMBC_TARGET_ROW(type, name, help)                                                          \
    name, NULL, help, UMBU_TEXT, UMBU_AT(type, target), .needed = true

/* Prints "umbrage: message" on stderr and returns the exit code of the error's status. */
int umbc_complain(const struct umb_error *error);

/* Prints "umbrage: FILE: message" and returns the exit code. A bad file is never a usage error, so
 * exit code 2 becomes 65. */
int umbc_complain_file(const char *path, const struct umb_error *error);

/* Prints "umbrage: " and the formatted message on stderr; returns the exit code of a status. */
int umbc_complain_as(enum umb_status status, const char *format, ...) UMB_PRINTF(2, 3);

/* Prints "umbrage COMMAND: message" and returns 2. command: NULL for none. */
int umbc_usage_error(const char *command, const char *format, ...) UMB_PRINTF(2, 3);

/* Option reader: 64 hexadecimal digits into uint8[UMB_ID_BYTES]. */
enum umb_status umbc_read_id(const struct umbu_option *option, const char *text, void *field,
                             struct umb_error *error);
#define UMBC_ID UMBU_READ(umbc_read_id, "an id of 64 hexadecimal digits")

/*
 * True if an argument means a file: it exists as one, ends in .umb or .umbm, begins with '/' or
 * '.', or cannot be an asset's name, which is NAME or FOLDER/NAME of [A-Za-z0-9._-].
 */
bool umbc_is_file(const char *word);

/* Opens a file for reading; messages name it. Fails: E_NO_INPUT (no such file, or a folder), or as
 * open does. */
UMB_CHECKED enum umb_status umbc_open_input(const char *path, FILE **file, struct umb_error *error);

/* Flushes stdout. Returns code, or 74 with a message if a write failed. */
int umbc_finish_stdout(int code);

/* Writes text from a file or a daemon to a terminal: control characters become blanks, because they
 * could command the terminal, and malformed UTF-8 becomes '?'. */
void umbc_print_text(FILE *file, const char *text, size_t length);

/* Writes a number of bytes as "1.5 GiB" or "12 B". */
void umbc_format_bytes(unsigned long long bytes, char text[32]);

/* Writes an id as a member of an object. */
void umbc_json_id(struct umbu_json *json, const char *key, const uint8_t id[UMB_ID_BYTES]);

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
 * In:  command: word that the user typed, for messages. program: "umbrage-bake". word: argument
 *      before the others, or NULL. arguments: NULL-terminated.
 * Returns the exit code after a failure only: 69 with a message if the program is missing.
 */
int umbc_start_program(const char *command, const char *program, const char *word,
                       char **arguments);

#endif
