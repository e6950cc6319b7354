/* SPDX-License-Identifier: Apache-2.0 */
/* Prints options as text: --help, a config file, and the rows of --print-options that other tools
 * read. */
#include "tool/options.h"

#include <string.h>

#define LINE_WIDTH  80U
#define HELP_COLUMN 26U

/* Prints words from `column` on. A word that does not fit begins a line at HELP_COLUMN. */
static void print_wrapped(FILE *out, const char *text, size_t column)
{
    while (*text != '\0') {
        const size_t length = strcspn(text, " ");
        if (column > HELP_COLUMN && column + 1 + length > LINE_WIDTH) {
            (void)fprintf(out, "\n%*s", (int)HELP_COLUMN, "");
            column = HELP_COLUMN;
        } else if (column > HELP_COLUMN) {
            (void)fputc(' ', out);
            column++;
        }
        (void)fprintf(out, "%.*s", (int)length, text);
        column += length;
        text += length + strspn(text + length, " ");
    }
    (void)fputc('\n', out);
}

/* Name of an option's value: NULL for a switch or an argument. */
static const char *value_name(const struct umbu_option *option)
{
    return option->value == NULL && option->kind == UMBU_KIND_CHOICE ? option->choices
                                                                     : option->value;
}

static const char *default_text(const struct umbu_option *option)
{
    return option->otherwise != NULL ? option->otherwise : option->standard;
}

static void print_option(const struct umbu_option *option, FILE *out)
{
    char left[96], text[1024], range[80] = "", letter[6] = "";
    const char *value = value_name(option), *standard = default_text(option);
    if (option->letter != '\0') {
        (void)snprintf(letter, sizeof letter, "-%c, ", option->letter);
    }
    const int length =
        snprintf(left, sizeof left, "  %s%s%s%s%s", letter, umbu_is_word(option) ? "" : "--",
                 option->name, value != NULL ? " " : "", value != NULL ? value : "");
    if (option->kind == UMBU_KIND_ODD) {
        umbu_expects(option, range, sizeof range);
    }
    (void)snprintf(text, sizeof text, "%s%s%s%s%s%s", option->help, range[0] != '\0' ? ": " : "",
                   range, standard != NULL ? " (default: " : "", standard != NULL ? standard : "",
                   standard != NULL ? ")" : "");
    if (length + 2 > (int)HELP_COLUMN) {
        (void)fprintf(out, "%s\n%*s", left, (int)HELP_COLUMN, "");
    } else {
        (void)fprintf(out, "%-*s", (int)HELP_COLUMN, left);
    }
    print_wrapped(out, text, HELP_COLUMN);
}

void umbu_print_help(const struct umbu_command *command, FILE *out)
{
    static const struct umbu_option help = {"help", NULL, "this text", UMBU_FLAG, .letter = 'h'};
    struct umbu_row row = {0};
    size_t printed = 0; /* Number of sections whose title is printed */
    (void)fprintf(out, "usage: %s\n\n%s\n", command->usage, command->summary);
    while (umbu_next_row(command, &row)) {
        for (; printed <= row.section; printed++) {
            if (printed == 1) {
                print_option(&help, out);
            }
            (void)fprintf(out, "\n%s:\n", command->sections[printed].title);
        }
        print_option(row.option, out);
    }
    if (printed == 1) {
        print_option(&help, out);
    }
    if (command->notes != NULL) {
        (void)fprintf(out, "\n%s\n", command->notes);
    }
}

/* Prints a text for a config file, in which a ';' after a blank begins a comment. */
static void print_text(FILE *out, const char *name, const char *text, size_t line_max)
{
    const bool tight = text[0] == ';' || strlen(name) + strlen(text) + 3 > line_max;
    (void)fprintf(out, "%s%s%s\n", name, tight ? "=" : " = ", text);
}

static void print_texts(const struct umbu_option *option, const void *field, size_t line_max,
                        FILE *out)
{
    const char *const *texts = field;
    if (option->kind == UMBU_KIND_LIST) {
        for (; *texts != NULL; texts++) {
            print_text(out, option->name, *texts, line_max);
        }
    } else if (*texts != NULL) {
        print_text(out, option->name, *texts, line_max);
    } else {
        (void)fprintf(out, "; %s = \n", option->name);
    }
}

static void print_setting(const struct umbu_option *option, const void *field, size_t line_max,
                          FILE *out)
{
    const char *word;
    if (option->type == UMBU_TYPE_TEXT || option->type == UMBU_TYPE_TEXTS) {
        print_texts(option, field, line_max, out);
        return;
    }
    const uint64_t number = umbu_get_integer(option, field);
    if (option->kind == UMBU_KIND_FLAG) {
        (void)fprintf(out, "%s = %s\n", option->name, number != 0 ? "true" : "false");
    } else if (option->kind == UMBU_KIND_CHOICE) {
        const size_t length = umbu_choice(option->choices, (size_t)number, &word);
        (void)fprintf(out, "%s = %.*s\n", option->name, (int)length, word);
    } else if (option->kind == UMBU_KIND_MODE) {
        (void)fprintf(out, "%s = %04llo\n", option->name, (unsigned long long)number);
    } else {
        (void)fprintf(out, "%s = %llu%s\n", option->name, (unsigned long long)number,
                      option->kind == UMBU_KIND_TIME ? "ms" : "");
    }
}

void umbu_print_settings(const struct umbu_command *command, const void *settings, size_t line_max,
                         FILE *out)
{
    struct umbu_row row = {0};
    while (umbu_next_row(command, &row)) {
        if (!row.option->not_in_file && !umbu_is_word(row.option)) {
            print_setting(row.option, (const char *)settings + row.at + row.option->at, line_max,
                          out);
        }
    }
}

void umbu_print_rows(const struct umbu_command *command, FILE *out)
{
    static const char *const kinds[] = {"flag",   "text",    "count", "odd",  "power",
                                        "number", "numbers", "bytes", "time", "choice",
                                        "sides",  "mode",    "list",  "read"};
    struct umbu_row row = {0};
    while (umbu_next_row(command, &row)) {
        const struct umbu_option *option = row.option;
        const char *value = value_name(option), *standard = default_text(option);
        const char letter[3] = {option->letter != '\0' ? '-' : '\0', option->letter, '\0'};
        (void)fprintf(
            out, "%s\t%s%s\t%s\t%s\t%s\t%s\t%s\t%s\t%s\n", command->name,
            umbu_is_word(option) ? "" : "--", option->name, letter, value != NULL ? value : "",
            kinds[option->kind], option->choices != NULL ? option->choices : "",
            standard != NULL ? standard : "", option->not_in_file ? "" : "file", option->help);
    }
    (void)fprintf(out, "%s\t--help\t-h\t\tflag\t\t\t\tthis text\n", command->name);
}
