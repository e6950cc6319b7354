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

/* Sub-commands of this program, in the order of --help: word, function, and what it does. */
/* clang-format off */
#define UMBC_COMMANDS(row)                                                                         \
    row("info", umbc_info, "describe an asset: lights, sizes, plan, settings")                     \
    row("query", umbc_query, "print the share of a light that reaches points")                     \
    row("sample", umbc_sample, "draw points near the shadow boundaries of an asset")               \
    row("list", umbc_list, "list the assets of a daemon")                                          \
    row("load", umbc_load, "load a daemon with queries and measure it")                            \
    row("submit", umbc_submit, "send a scene to a daemon to bake")                                 \
    row("watch", umbc_watch, "show the progress of a job until its end")                           \
    row("jobs", umbc_jobs, "list your jobs")                                                       \
    row("cancel", umbc_cancel, "cancel a job")                                                     \
    row("fetch", umbc_fetch, "download an asset of yours")                                         \
    row("rm", umbc_rm, "give up an asset of yours")                                                \
    row("verify", umbc_verify,                                                                     \
        "prove a file's integrity and identity, or check it against its scene")                    \
    row("stream", umbc_paging, "fetch the needed part of an asset, coarse first")                  \
    row("view", umbc_view, "show an asset and its scene in the browser")                           \
    row("derive", umbc_derive, "make shadow maps for a GPU from an asset alone")                   \
    row("frames", umbc_frames, "ask a daemon for the shadows of one frame after the other")        \
    row("pack", umbc_pack, "convert a file to the packed form (.umb)")                             \
    row("unpack", umbc_unpack, "convert a file to the mapped form (.umbm)")
/* clang-format on */

#define UMBC_DECLARE(word, run, summary) int run(int argc, char **argv);
UMBC_COMMANDS(UMBC_DECLARE)

/* Finds the folder of the running program, without the last slash. Returns false if it fails.
 * Out: folder: char[size]. */
bool umbc_own_folder(char *folder, size_t size);

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
