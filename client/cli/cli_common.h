/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_CLI_COMMON_H
#define UMBRAGE_CLI_CLI_COMMON_H
/*
 * What the sub-commands share: options from a table, talk on stderr, finding the daemon.
 *
 * Every sub-command is one function `int umbc_NAME(argc, argv)` that returns the exit code; argv[0]
 * is the sub-command's name. stdout is data, stderr is talk.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include "umbrage/client.h"

#define UMBC_OPTIONS_MAX     28
#define UMBC_WORDS_MAX       4
#define UMBC_EXIT_NEGATIVE   1 /* the command worked and the answer is no */
#define UMBC_EXIT_USAGE      2
#define UMBC_EXIT_DATA       65
#define UMBC_EXIT_MISSING    69
#define UMBC_DEFAULT_ADDRESS "tcp:127.0.0.1:7420"

struct umbc_option {
    const char *name;  /* without the dashes */
    const char *value; /* what it takes, for --help; NULL = a switch */
    const char *help;
    char letter; /* short form, 0 = none */
};

/* What leads to the daemon, see cli_session.h. */
enum umbc_session_option {
    UMBC_SESSION_ADDRESS,
    UMBC_SESSION_CA,
    UMBC_SESSION_CERTIFICATE,
    UMBC_SESSION_KEY,
    UMBC_SESSION_NAME,
    UMBC_SESSION_TOKEN,
    UMBC_SESSION_COUNT,
};

struct umbc_command {
    const char *usage;                 /* "umbrage info FILE|ASSET [options]" */
    const char *summary;               /* one or more lines for --help */
    const struct umbc_option *options; /* --help is added by itself */
    size_t option_count;
    size_t min_words, max_words; /* arguments that are no options */
    bool connects;               /* has the options of cli_session.h, too */
};

struct umbc_parsed {
    const char *values[UMBC_OPTIONS_MAX]; /* "" for a switch, NULL = not given */
    const char *words[UMBC_WORDS_MAX];
    size_t word_count;
    const char *session[UMBC_SESSION_COUNT]; /* NULL = not given */
};

/*
 * Reads arguments. Returns -1 to go on, else the exit code: 0 after --help (printed on stdout), 2
 * after a usage error (explained on stderr). An option given twice keeps the last value; "--" ends
 * the options.
 */
int umbc_parse(const struct umbc_command *command, int argc, char **argv,
               struct umbc_parsed *parsed);

/* Prints "umbrage: message" on stderr and returns the exit code of the error's status. */
int umbc_complain(const struct umb_error *error);

/* The same for an error about a file, which is named, and whose content is never a usage error: 2
 * becomes 65. */
int umbc_complain_file(const char *path, const struct umb_error *error);

/* The same with a message made here; exit code of status. */
int umbc_complain_as(enum umb_status status, const char *format, ...) UMB_PRINTF(2, 3);

/* Prints a usage error and returns 2. */
int umbc_usage_error(const char *format, ...) UMB_PRINTF(1, 2);

/* Refuses an output of `-` beside --json, since both want stdout: prints a usage error and returns
 * 2, else -1. output: may be NULL. */
int umbc_check_stdout(const char *command, const char *output, bool json);

/* Index of a word in a list, or -1. */
int umbc_find_word(const char *text, const char *const *words, size_t count);

/*
 * True if an argument means a file: it exists as one, ends in .umb or .umbm, begins with '/' or
 * '.', or cannot be an asset's name, which is NAME or FOLDER/NAME of [A-Za-z0-9._-].
 */
bool umbc_is_file(const char *word);

/* Opens a file to be read, which messages name. Fails: E_NO_INPUT if there is none or it is a
 * folder, else as open does. */
UMB_CHECKED enum umb_status umbc_open_input(const char *path, FILE **file, struct umb_error *error);

/* Parses a whole decimal number. Returns false if text is anything else or above max. */
bool umbc_parse_count(const char *text, unsigned long long max, unsigned long long *value);

/* Parses "64K", "2M", "1G" or plain bytes, 1 or more. */
bool umbc_parse_bytes(const char *text, uint64_t *bytes);

/* Parses a finite number that ends where text ends. */
bool umbc_parse_number(const char *text, double *value);

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
 * In: program: "umbrage-bake". prefix: words put before the arguments, may be none. arguments:
 *     NULL-terminated. command: what was typed, for the message.
 * Returns only if that failed: 69 with a sentence if the program is missing.
 */
int umbc_start_program(const char *command, const char *program, const char *const *prefix,
                       char **arguments);

#endif
