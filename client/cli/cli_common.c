/* SPDX-License-Identifier: Apache-2.0 */
/* Shared pieces of the sub-commands, see cli_common.h. */
#include "cli_common.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include "tool/base.h"
#include "cli_session.h"
#include "tool/exit_code.h"

#define NAME_BYTES ((size_t)200) /* of a path, in messages of the libraries */

static void print_option(const struct umbc_option *option)
{
    char left[48];
    char letter[4] = "";
    if (option->letter != '\0') {
        (void)snprintf(letter, sizeof letter, "-%c,", option->letter);
    }
    (void)snprintf(left, sizeof left, "%3s --%s%s%s", letter, option->name,
                   option->value != NULL ? " " : "", option->value != NULL ? option->value : "");
    (void)printf("  %-28s %s\n", left, option->help);
}

static void print_help(const struct umbc_command *command)
{
    (void)printf("usage: %s\n\n%s\n\noptions:\n", command->usage, command->summary);
    for (size_t i = 0; i < command->option_count; i++) {
        print_option(&command->options[i]);
    }
    (void)printf("  %-28s %s\n", "    --help", "this text");
    if (command->connects) {
        (void)printf("\nthe daemon:\n");
        for (size_t i = 0; i < UMBC_SESSION_COUNT; i++) {
            print_option(&UMBC_SESSION_OPTIONS[i]);
        }
    }
}

int umbc_usage_error(const char *format, ...)
{
    va_list arguments;
    (void)fputs("umbrage: ", stderr);
    va_start(arguments, format);
    (void)vfprintf(stderr, format, arguments);
    va_end(arguments);
    (void)fputs(" (try --help)\n", stderr);
    return UMBC_EXIT_USAGE;
}

int umbc_check_stdout(const char *command, const char *output, bool json)
{
    return json && output != NULL && strcmp(output, "-") == 0
               ? umbc_usage_error("%s: -o - and --json both want stdout", command)
               : -1;
}

static const char *said(const struct umb_error *error)
{
    return error->message[0] != '\0' ? error->message : umb_status_text(error->status);
}

int umbc_complain(const struct umb_error *error)
{
    (void)fprintf(stderr, "umbrage: %s\n", said(error));
    return umbu_exit_code(error->status);
}

/* What stands after the name in messages of the form `NAME: reason`; NULL in others. */
static const char *after_name(const char *message, const char *name)
{
    const size_t length = strlen(name);
    return strncmp(message, name, length) == 0 && message[length] == ':' ? message + length : NULL;
}

int umbc_complain_file(const char *path, const struct umb_error *error)
{
    const char *message = said(error);
    const size_t length = strlen(path);
    char name[NAME_BYTES + 1], quoted[sizeof name + 2]; /* as messages have it */
    (void)umb__utf8_printable((const uint8_t *)path, length < NAME_BYTES ? length : NAME_BYTES,
                              name, sizeof name);
    (void)snprintf(quoted, sizeof quoted, "'%s'", name);
    const char *reason = after_name(message, name);
    (void)fputs("umbrage: ", stderr);
    if (reason == NULL && strstr(message, quoted) != NULL) {
        (void)fprintf(stderr, "%s\n", message);
    } else {
        umbc_print_text(stderr, path, length);
        (void)fprintf(stderr, "%s%s\n", reason != NULL ? "" : ": ",
                      reason != NULL ? reason : message);
    }
    int code = umbu_exit_code(error->status);
    return code == UMBC_EXIT_USAGE ? UMBC_EXIT_DATA : code;
}

int umbc_complain_as(enum umb_status status, const char *format, ...)
{
    va_list arguments;
    (void)fputs("umbrage: ", stderr);
    va_start(arguments, format);
    (void)vfprintf(stderr, format, arguments);
    va_end(arguments);
    (void)fputc('\n', stderr);
    return umbu_exit_code(status);
}

/* All options of a command: its own, then those that lead to the daemon. */
static size_t count_options(const struct umbc_command *command)
{
    return command->option_count + (command->connects ? UMBC_SESSION_COUNT : 0);
}

static const struct umbc_option *option_at(const struct umbc_command *command, size_t index)
{
    return index < command->option_count ? &command->options[index]
                                         : &UMBC_SESSION_OPTIONS[index - command->option_count];
}

/* Finds "--name" or "--name=value"; *value is what follows '=', or NULL. -1 if unknown. */
static int find_long(const struct umbc_command *command, const char *text, const char **value)
{
    const char *equals = strchr(text, '=');
    size_t length = equals == NULL ? strlen(text) : (size_t)(equals - text);
    *value = equals == NULL ? NULL : equals + 1;
    for (size_t i = 0; i < count_options(command); i++) {
        const char *name = option_at(command, i)->name;
        if (strlen(name) == length && strncmp(name, text, length) == 0) {
            return (int)i;
        }
    }
    return -1;
}

/* Finds "-o" or "-oVALUE". */
static int find_short(const struct umbc_command *command, const char *text, const char **value)
{
    *value = text[1] == '\0' ? NULL : text + 1;
    for (size_t i = 0; i < command->option_count; i++) {
        if (command->options[i].letter == text[0]) {
            return (int)i;
        }
    }
    return -1;
}

/* Takes the option at argv[*at]; moves *at over a value in the next argument. */
static int take_option(const struct umbc_command *command, int argc, char **argv, int *at,
                       struct umbc_parsed *parsed)
{
    const char *text = argv[*at];
    const char *value;
    int found = text[1] == '-' ? find_long(command, text + 2, &value)
                               : find_short(command, text + 1, &value);
    if (found < 0) {
        return umbc_usage_error("%s: unknown option '%s'", argv[0], text);
    }
    const struct umbc_option *option = option_at(command, (size_t)found);
    const char **place = (size_t)found < command->option_count
                             ? &parsed->values[found]
                             : &parsed->session[(size_t)found - command->option_count];
    if (option->value == NULL) {
        if (value != NULL) {
            return umbc_usage_error("%s: --%s takes no value", argv[0], option->name);
        }
        *place = "";
        return -1;
    }
    if (value == NULL) {
        if (*at + 1 >= argc) {
            return umbc_usage_error("%s: --%s needs a value: %s", argv[0], option->name,
                                    option->value);
        }
        value = argv[++*at];
    }
    *place = value;
    return -1;
}

int umbc_parse(const struct umbc_command *command, int argc, char **argv,
               struct umbc_parsed *parsed)
{
    bool options_over = false;
    memset(parsed, 0, sizeof *parsed);
    for (int at = 1; at < argc; at++) {
        const char *text = argv[at];
        if (!options_over && strcmp(text, "--") == 0) {
            options_over = true;
        } else if (!options_over && (strcmp(text, "--help") == 0 || strcmp(text, "-h") == 0)) {
            print_help(command);
            return umbc_finish_stdout(0);
        } else if (!options_over && text[0] == '-' && text[1] != '\0') {
            int code = take_option(command, argc, argv, &at, parsed);
            if (code >= 0) {
                return code;
            }
        } else if (parsed->word_count == command->max_words) {
            return umbc_usage_error("%s: unexpected argument '%s'", argv[0], text);
        } else {
            parsed->words[parsed->word_count++] = text;
        }
    }
    if (parsed->word_count < command->min_words) {
        return umbc_usage_error("%s: an argument is missing; usage: %s", argv[0], command->usage);
    }
    return -1;
}

/* 1 for what the store would take as a name, and for ids. */
static bool may_be_asset(const char *word)
{
    static const char allowed[] =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";
    const size_t folder = strspn(word, allowed);
    const char *name = word[folder] == '/' ? word + folder + 1 : word;
    return word[0] != '.' && word[0] != '/' && name[0] != '.' && name[0] != '\0' &&
           name[strspn(name, allowed)] == '\0';
}

int umbc_find_word(const char *text, const char *const *words, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (strcmp(text, words[i]) == 0) {
            return (int)i;
        }
    }
    return -1;
}

bool umbc_is_file(const char *word)
{
    struct stat info;
    size_t length = strlen(word);
    if (!may_be_asset(word) || (length > 4 && strcmp(word + length - 4, ".umb") == 0) ||
        (length > 5 && strcmp(word + length - 5, ".umbm") == 0)) {
        return true;
    }
    return stat(word, &info) == 0 && !S_ISDIR(info.st_mode);
}

enum umb_status umbc_open_input(const char *path, FILE **file, struct umb_error *error)
{
    struct stat info;
    *file = fopen(path, "rb");
    if (*file == NULL) {
        const int code = errno;
        return umb_fail_errno(error, umb__open_status(code), code, "cannot open '%.200s'", path);
    }
    if (fstat(fileno(*file), &info) == 0 && S_ISDIR(info.st_mode)) {
        (void)fclose(*file);
        *file = NULL;
        return umb_fail(error, UMB_E_NO_INPUT, "cannot read '%.200s': it is a folder", path);
    }
    return UMB_OK;
}

bool umbc_parse_count(const char *text, unsigned long long max, unsigned long long *value)
{
    char *end;
    if (text[0] < '0' || text[0] > '9') {
        return false;
    }
    errno = 0;
    *value = strtoull(text, &end, 10);
    return errno == 0 && *end == '\0' && *value <= max;
}

bool umbc_parse_bytes(const char *text, uint64_t *bytes)
{
    char digits[24];
    unsigned long long value;
    const size_t length = strlen(text);
    if (length == 0 || length >= sizeof digits) {
        return false;
    }
    const char *units = "KMG", *unit = strchr(units, text[length - 1]);
    memcpy(digits, text, length + 1);
    if (unit) {
        digits[length - 1] = '\0';
    }
    const unsigned shift = unit ? 10 * (unsigned)(unit - units + 1) : 0;
    if (!umbc_parse_count(digits, UINT64_MAX >> 34, &value) || value == 0) {
        return false;
    }
    *bytes = (uint64_t)value << shift;
    return true;
}

bool umbc_parse_number(const char *text, double *value)
{
    char *end;
    /* strtod also knows hexadecimal, inf and nan; none of them is a coordinate anybody means. The
     * program never calls setlocale, so that the decimal point is a point. */
    if (text[0] == '\0' || text[strspn(text, "0123456789+-.eE")] != '\0') {
        return false;
    }
    *value = strtod(text, &end);
    return *end == '\0' && isfinite(*value);
}

int umbc_finish_stdout(int code)
{
    if (fflush(stdout) != 0 || ferror(stdout)) {
        return umbc_complain_as(UMB_E_IO, "cannot write to stdout");
    }
    return code;
}

void umbc_print_text(FILE *file, const char *text, size_t length)
{
    char piece[256];
    size_t at = 0;
    while (at < length) {
        size_t count =
            umb__utf8_printable((const uint8_t *)text + at, length - at, piece, sizeof piece);
        (void)fwrite(piece, 1, count, file);
        at += count; /* at least one: the longest character fits */
    }
}

void umbc_format_bytes(unsigned long long bytes, char text[32])
{
    static const char *const units[] = {"B", "KiB", "MiB", "GiB", "TiB"};
    double value = (double)bytes;
    size_t unit = 0;
    while (value >= 1024 && unit + 1 < sizeof units / sizeof units[0]) {
        value /= 1024;
        unit++;
    }
    (void)snprintf(text, 32, unit == 0 ? "%.0f %s" : "%.2f %s", value, units[unit]);
}
