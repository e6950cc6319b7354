/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_OPTIONS_H
#define UMBRAGE_TOOL_OPTIONS_H
/*
 * Options of a program, from one table: the command line, --help, the manual page, the config file
 * and the shell completions.
 *
 *     struct settings {
 *         const char *scene;
 *         uint32_t taps;
 *         bool json;
 *     };
 *     #define AT(field) UMBU_AT(struct settings, field)
 *     static const struct umbu_option OPTIONS[] = {
 *         {"SCENE", NULL, "the scene", UMBU_TEXT, AT(scene), .needed = true},
 *         {"taps", "N", "width of the window", UMBU_ODD(1, 17), AT(taps), .standard = "1"},
 *         {"json", NULL, "print one JSON object", UMBU_FLAG, AT(json)},
 *     };
 *     static const struct umbu_command COMMAND = {
 *         .name = "umbrage look", .usage = "umbrage look SCENE [options]", .summary = "Looks.",
 *         .sections = {{"options", UMBU_ROWS(OPTIONS)}}};
 *     int code = umbu_start(&parsed, &COMMAND, argc, argv, &settings);
 *
 * A name in capitals is an argument by its place; every other row is an option. An option has the
 * forms `--name VALUE`, `--name=VALUE`, `-o VALUE`, `-oVALUE` and `--switch`; `--` ends the
 * options. The last value of an option counts, unless its reader collects values. Every command has
 * --help and -h. A value is stored as the type of its field, which UMBU_AT records.
 *
 * Threads: pure functions of their arguments. Trust: arguments and config files may hold anything.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include "umbrage/query.h"

#define UMBU_OPTIONS_MAX  128 /* rows of a command, all sections together */
#define UMBU_SECTIONS_MAX 6

/* How a value is read. */
enum umbu_kind {
    UMBU_KIND_FLAG = 0, /* no value; true or false in a config file */
    UMBU_KIND_TEXT,     /* not empty */
    UMBU_KIND_COUNT,    /* decimal digits, min to max */
    UMBU_KIND_ODD,
    UMBU_KIND_POWER,   /* a power of two */
    UMBU_KIND_NUMBER,  /* finite, low to high; whole for an int */
    UMBU_KIND_NUMBERS, /* `count` numbers with commas between them */
    UMBU_KIND_BYTES,   /* number and K, KiB, M, MiB, G, GiB, TiB or nothing */
    UMBU_KIND_TIME,    /* number and ms, s, m or nothing (seconds); min and max in milliseconds */
    UMBU_KIND_CHOICE,  /* a word of `choices`; the field gets its index */
    UMBU_KIND_SIDES,   /* WxH, each 1 to max */
    UMBU_KIND_MODE,    /* octal permissions that hold all bits of min */
    UMBU_KIND_LIST,    /* one text each time, at most max; `read`, if not NULL, checks each */
    UMBU_KIND_READ,    /* read by `read` */
};

/* The type of a field. */
enum umbu_type {
    UMBU_TYPE_OTHER = 0,
    UMBU_TYPE_BOOL,
    UMBU_TYPE_INT,
    UMBU_TYPE_UINT,
    UMBU_TYPE_ULONG,
    UMBU_TYPE_DOUBLE,
    UMBU_TYPE_TEXT,
    UMBU_TYPE_DOUBLES,
    UMBU_TYPE_UINTS,
    UMBU_TYPE_TEXTS,
};

struct umbu_option;

/* Reads one value into its field. Fails: E_ARGUMENT; umbu_refuse says why. */
typedef enum umb_status (*umbu_read_fn)(const struct umbu_option *option, const char *text,
                                        void *field, struct umb_error *error);

struct umbu_option {
    const char *name;  /* Name without dashes; in capitals: an argument by its place */
    const char *value; /* Name of the value in --help; NULL for a switch, an argument or choices */
    const char *help;  /* One phrase: what the option sets, unit and range; no full stop */
    enum umbu_kind kind;
    enum umbu_type type;
    size_t at;           /* Offset in bytes of the field in the section's settings */
    uint64_t min, max;   /* Range of an integer, of bytes or of milliseconds */
    double low, high;    /* Range of a number; high of UMBU_KIND_SIDES: most pixels, 0 = any */
    unsigned count;      /* Number of values of UMBU_KIND_NUMBERS */
    bool above;          /* True if the range leaves out its lower end */
    bool as_log2;        /* True if the field gets the exponent of the power of two */
    const char *choices; /* Words, "text|f32|f64"; an empty one is an index that has no word */
    const char *unit;    /* Unit that may follow a number, as "deg" */
    double scale;        /* Factor from the number to the field, 0 = 1 */
    umbu_read_fn read;   /* Reader of UMBU_KIND_READ, or check of one text of UMBU_KIND_LIST */
    /* Words for the values that `read` accepts; error messages put "give " before them */
    const char *expects;
    const char *standard;  /* Default value, read like any other; NULL leaves the field at zero */
    const char *otherwise; /* Default in words, where it is no constant; for --help */
    const char *needs;     /* Conditions that must hold: "camera|path format=f32|f64" */
    const char *excludes;  /* Conditions that must not hold, in the same form */
    const char *fields;    /* Names that errors of the library use: "footprint|footprint_m" */
    /* Name of the query setting that the row sets (base/query_settings.h), or NULL. The setting
     * gives name, value, help, kind and range where the row leaves them out. "*" stands for a row
     * for each setting that no other row of the command has in `setting` or `fields` */
    const char *setting;
    char letter;       /* Short form, 0 = none */
    bool needed;       /* True if the command cannot do without it */
    bool alone;        /* True if nothing else is read or checked with it, as --version */
    bool not_in_file;  /* True if no config file has it */
    bool may_be_empty; /* True if an empty text is a value */
};

/* Place of a value: a field of the section's settings, and its type. */
#define UMBU_AT(type_, field)                                                                      \
    .at = offsetof(type_, field),                                                                  \
    .type = _Generic(((type_ *)0)->field,                                                          \
        bool: UMBU_TYPE_BOOL,                                                                      \
        int: UMBU_TYPE_INT,                                                                        \
        unsigned: UMBU_TYPE_UINT,                                                                  \
        unsigned long: UMBU_TYPE_ULONG,                                                            \
        long: UMBU_TYPE_ULONG,                                                                     \
        double: UMBU_TYPE_DOUBLE,                                                                  \
        const char *: UMBU_TYPE_TEXT,                                                              \
        double *: UMBU_TYPE_DOUBLES,                                                               \
        unsigned *: UMBU_TYPE_UINTS,                                                               \
        const char **: UMBU_TYPE_TEXTS,                                                            \
        default: UMBU_TYPE_OTHER)

#define UMBU_FLAG                  .kind = UMBU_KIND_FLAG
#define UMBU_TEXT                  .kind = UMBU_KIND_TEXT
#define UMBU_COUNT(low_, high_)    .kind = UMBU_KIND_COUNT, .min = (low_), .max = (high_)
#define UMBU_ODD(low_, high_)      .kind = UMBU_KIND_ODD, .min = (low_), .max = (high_)
#define UMBU_POWER(low_, high_)    .kind = UMBU_KIND_POWER, .min = (low_), .max = (high_)
#define UMBU_LOG2(low_, high_)     UMBU_POWER(low_, high_), .as_log2 = true
#define UMBU_NUMBER(low_, high_)   .kind = UMBU_KIND_NUMBER, .low = (low_), .high = (high_)
#define UMBU_ABOVE(low_, high_)    UMBU_NUMBER(low_, high_), .above = true
#define UMBU_NUMBERS(count_)       .kind = UMBU_KIND_NUMBERS, .count = (count_)
#define UMBU_BYTES(low_, high_)    .kind = UMBU_KIND_BYTES, .min = (low_), .max = (high_)
#define UMBU_TIME(low_ms, high_ms) .kind = UMBU_KIND_TIME, .min = (low_ms), .max = (high_ms)
#define UMBU_CHOICE(words)         .kind = UMBU_KIND_CHOICE, .choices = (words)
#define UMBU_SIDES(limit_)         .kind = UMBU_KIND_SIDES, .max = (limit_)
#define UMBU_MODE(least, most)     .kind = UMBU_KIND_MODE, .min = (least), .max = (most)
#define UMBU_LIST(most)            .kind = UMBU_KIND_LIST, .max = (most)
#define UMBU_READ(function, expects_)                                                              \
    .kind = UMBU_KIND_READ, .read = (function), .expects = (expects_)

/* Rows of options that most commands have, for fields `json` and `quiet`. The caller adds the
 * braces and further fields. */
#define UMBU_JSON_ROW(type_) "json", NULL, "print one JSON object", UMBU_FLAG, UMBU_AT(type_, json)
#define UMBU_QUIET_ROW(type_, help_)                                                               \
    "quiet", NULL, help_, UMBU_FLAG, UMBU_AT(type_, quiet), .letter = 'q'

/* Row for the angular diameter of a light in radians. The caller adds the braces. */
#define UMBU_LIGHT_SIZE_ROW(type_, field)                                                          \
    "light-size", "DEG", "angular diameter of the light in degrees, for --filter penumbra",        \
        .setting = "light_extent", .unit = "deg", .scale = UMBU_RAD_A_DEG, UMBU_AT(type_, field),  \
        .otherwise = "the asset's"
#define UMBU_RAD_A_DEG 0.017453292519943295

/* Row for the bias of a struct umb_query_settings. The caller adds the braces. */
#define UMBU_BIAS_ROW(type_, member)                                                               \
    "bias", "BIAS", "distance that points move off their surface: auto, none, 1.5vox or 0.02m",    \
        UMBU_BIAS, UMBU_AT(type_, member), .otherwise = "auto", .fields = "bias|bias_mode"

/* Stands for a row for each query setting that no other row sets; the values go to a struct
 * umb_query_settings. not_taken: names of settings that the command does not take, "a|b". The
 * caller adds the braces. */
#define UMBU_OTHER_SETTINGS(type_, member, not_taken)                                              \
    .setting = "*", UMBU_AT(type_, member), .fields = (not_taken)

/* A group of rows in --help. */
struct umbu_section {
    const char *title;
    const struct umbu_option *options;
    size_t count;
    size_t at; /* Offset in bytes of the section's settings in those of the command */
};
#define UMBU_ROWS(table) (table), sizeof(table) / sizeof(table)[0], 0

struct umbu_command {
    const char *name;                                /* Begin of messages: "umbrage query" */
    const char *usage;                               /* Lines after "usage: " */
    const char *summary;                             /* Lines before the options */
    const char *notes;                               /* Lines after the options, or NULL */
    struct umbu_section sections[UMBU_SECTIONS_MAX]; /* To the first without options */
};

struct umbu_parsed {
    const struct umbu_command *command;
    void *settings;
    const struct umbu_option *alone;       /* Option with `alone` that was given, or NULL */
    bool help;                             /* --help was given */
    unsigned char source;                  /* Number of the source that is being read */
    unsigned char given[UMBU_OPTIONS_MAX]; /* Number of the row's last source, 0 = not given */
};

/* Sets every field to its standard value, and marks no option as given. The caller zeroes the
 * settings first. Aborts if the table is wrong: a field does not fit its kind, or a standard value
 * is out of range. */
void umbu_begin(struct umbu_parsed *parsed, const struct umbu_command *command, void *settings);

/*
 * Reads argv[1] to argv[argc - 1]; texts are borrowed from there. A list from an earlier source,
 * such as a config file, is replaced. Fails: E_ARGUMENT naming the option, the value and what to
 * give instead.
 */
UMB_CHECKED enum umb_status umbu_take_arguments(struct umbu_parsed *parsed, int argc, char **argv,
                                                struct umb_error *error);

/* Reads one setting of a config file; value is borrowed. Fails: E_ARGUMENT, also for a setting that
 * is no list and was given before by this source. */
UMB_CHECKED enum umb_status umbu_take_setting(struct umbu_parsed *parsed, const char *name,
                                              const char *value, struct umb_error *error);

/* Checks `needed`, `needs` and `excludes`. With --help, or an option that is `alone`, every
 * combination is allowed. */
UMB_CHECKED enum umb_status umbu_check(const struct umbu_parsed *parsed, struct umb_error *error);

/* Calls umbu_begin, umbu_take_arguments and umbu_check. */
UMB_CHECKED enum umb_status umbu_parse(struct umbu_parsed *parsed,
                                       const struct umbu_command *command, int argc, char **argv,
                                       void *settings, struct umb_error *error);

/*
 * Calls umbu_parse for a command. Prints the help or, with `--print-options` alone, the rows on
 * stdout, and a failure as umbu_end does. Returns -1 to go on, else the exit code.
 */
int umbu_start(struct umbu_parsed *parsed, const struct umbu_command *command, int argc,
               char **argv, void *settings);

/* Ends a command: prints "NAME: message" on stderr unless status is UMB_OK. Returns the exit code.
 */
int umbu_end(const struct umbu_command *command, enum umb_status status,
             const struct umb_error *error);

/* Returns true if the option or argument of row `name` was given. Aborts without such a row. */
bool umbu_given(const struct umbu_parsed *parsed, const char *name);

/* For readers of options: fails with E_ARGUMENT. The message has the option, the value, and what to
 * give instead. */
enum umb_status umbu_refuse(const struct umbu_option *option, const char *text,
                            struct umb_error *error);

/* Option reader: "auto", "none", "1.5vox" or "0.02m" into a struct umb_query_settings. */
enum umb_status umbu_read_bias(const struct umbu_option *option, const char *text, void *field,
                               struct umb_error *error);
#define UMBU_BIAS                                                                                  \
    UMBU_READ(umbu_read_bias, "auto, none, or a number from 0 to 1e6 with vox or m, as 1.5vox")

/* Option reader: the name of a file or folder, of 1 to 4095 bytes and not "-", into a const char
 * *. */
enum umb_status umbu_read_name(const struct umbu_option *option, const char *text, void *field,
                               struct umb_error *error);
#define UMBU_NAME(expects_) UMBU_READ(umbu_read_name, expects_)

/* Reads decimal digits at *text and moves *text after them; false: no digits, or too many. */
bool umbu_read_count(const char **text, uint64_t *value);

/* Reads a finite decimal number at *text and moves *text after it; false: there is none. */
bool umbu_read_number(const char **text, double *value);

/* Reads numbers with commas between them, to the end of text. */
bool umbu_read_numbers(const char *text, size_t count, double *values);

/* Prints usage, summary, options and notes, wrapped at 80 columns. */
void umbu_print_help(const struct umbu_command *command, FILE *out);

/* Prints every setting that a config file may have, in a form that reads back the same. line_max:
 * longest line in bytes that the reader of the file takes. */
void umbu_print_settings(const struct umbu_command *command, const void *settings, size_t line_max,
                         FILE *out);

/*
 * Prints a line for each option: command, option, letter, value, kind, choices, default, "file" if
 * a config file may have it, help; a tab between them. Completions, manual pages and tests use
 * these lines.
 */
void umbu_print_rows(const struct umbu_command *command, FILE *out);

/* Replaces the name of a library field at the beginning of a message by "--option". */
void umbu_name_options(const struct umbu_command *command, struct umb_error *error);

/* --- for the files of this folder --- */

/* A row of a command. */
struct umbu_row {
    const struct umbu_option *option; /* NULL: before the first row */
    size_t index;                     /* Index in umbu_parsed.given */
    size_t section;                   /* Index in umbu_command.sections */
    size_t at;                        /* Offset in bytes of the section's settings */
    size_t next, next_setting;        /* Indices in the section and of umb__settings */
    struct umbu_option made;          /* Row made of a setting, and its name */
    char name[40];
};

/* Steps to the next row; false after the last. *row begins as zeros, and is never copied. */
bool umbu_next_row(const struct umbu_command *command, struct umbu_row *row);

/* True if a word is one of "a|b|c" (length bytes). */
bool umbu_is_among(const char *list, size_t length, const char *word, size_t word_length);

/* Reads a value into its field. */
enum umb_status umbu_read_value(const struct umbu_option *option, const char *text, void *field,
                                struct umb_error *error);

/* True for an argument by its place. */
bool umbu_is_word(const struct umbu_option *option);

/* Finds word number `index` of "a|b|c". Out: word: address of the word. Returns the word's length;
 * 0 after the last word. */
size_t umbu_choice(const char *choices, size_t index, const char **word);

/* Reads a field of any integer type. */
uint64_t umbu_get_integer(const struct umbu_option *option, const void *field);

/* Writes a description of the values that an option takes, such as "a whole number from 1 to 9". */
void umbu_expects(const struct umbu_option *option, char *text, size_t size);

#endif
