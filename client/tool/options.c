/* SPDX-License-Identifier: Apache-2.0 */
/* Command lines and config files by table, see options.h. */
#include "tool/options.h"
#include "tool/exit_code.h"
#include "tool/tool_try.h"

#include <stdlib.h>
#include <string.h>

static bool find_name(const struct umbu_command *command, const char *name, size_t length,
                      struct umbu_row *found)
{
    *found = (struct umbu_row){0};
    while (umbu_next_row(command, found)) {
        if (strlen(found->option->name) == length &&
            memcmp(found->option->name, name, length) == 0) {
            return true;
        }
    }
    return false;
}

static bool find_letter(const struct umbu_command *command, char letter, struct umbu_row *found)
{
    *found = (struct umbu_row){0};
    while (umbu_next_row(command, found)) {
        if (found->option->letter == letter) {
            return true;
        }
    }
    return false;
}

static void *field_of(const struct umbu_parsed *parsed, const struct umbu_row *found)
{
    return (char *)parsed->settings + found->at + found->option->at;
}

/* False for a row whose field is not of the type that its kind stores. */
static bool is_sound(const struct umbu_option *option)
{
    const enum umbu_type type = option->type;
    const bool is_integer = type == UMBU_TYPE_ULONG || type == UMBU_TYPE_UINT;
    switch (option->kind) {
    case UMBU_KIND_FLAG:
        return type == UMBU_TYPE_BOOL || type == UMBU_TYPE_INT || type == UMBU_TYPE_UINT;
    case UMBU_KIND_TEXT:
        return type == UMBU_TYPE_TEXT;
    case UMBU_KIND_NUMBER:
        return type == UMBU_TYPE_DOUBLE || type == UMBU_TYPE_INT;
    case UMBU_KIND_NUMBERS:
        return type == UMBU_TYPE_DOUBLES && option->count > 0;
    case UMBU_KIND_CHOICE:
        return is_integer || type == UMBU_TYPE_TEXT;
    case UMBU_KIND_SIDES:
        return type == UMBU_TYPE_UINTS;
    case UMBU_KIND_LIST:
        return type == UMBU_TYPE_TEXTS;
    case UMBU_KIND_READ:
        return option->read != NULL && option->expects != NULL;
    case UMBU_KIND_TIME:
        return is_integer || type == UMBU_TYPE_DOUBLE;
    default:
        return type == UMBU_TYPE_ULONG || (type == UMBU_TYPE_UINT && option->max <= UINT32_MAX);
    }
}

void umbu_begin(struct umbu_parsed *parsed, const struct umbu_command *command, void *settings)
{
    struct umbu_row found = {0};
    *parsed = (struct umbu_parsed){.command = command, .settings = settings};
    while (umbu_next_row(command, &found)) {
        if (found.index >= UMBU_OPTIONS_MAX || !is_sound(found.option) ||
            (found.option->standard != NULL &&
             umbu_read_value(found.option, found.option->standard, field_of(parsed, &found),
                             NULL) != UMB_OK)) {
            abort(); /* the table is wrong; tests read every table */
        }
    }
}

/* Stores a value. A list's first value from a new source replaces those of earlier sources. */
static enum umb_status take_value(struct umbu_parsed *parsed, const struct umbu_row *found,
                                  const char *text, struct umb_error *error)
{
    const struct umbu_option *option = found->option;
    void *field = field_of(parsed, found);
    if (option->kind == UMBU_KIND_LIST && parsed->given[found->index] != parsed->source) {
        memset(field, 0, sizeof(const char *));
    }
    parsed->given[found->index] = parsed->source;
    if (option->alone) {
        parsed->alone = option;
    }
    return umbu_read_value(option, text, field, error);
}

/* Stores an argument in the first place without a value. */
static enum umb_status take_word(struct umbu_parsed *parsed, const char *text,
                                 struct umb_error *error)
{
    struct umbu_row found = {0};
    size_t words = 0;
    while (umbu_next_row(parsed->command, &found)) {
        if (umbu_is_word(found.option)) {
            if (parsed->given[found.index] == 0) {
                return take_value(parsed, &found, text, error);
            }
            words++;
        }
    }
    return words == 0
               ? umb_fail(error, UMB_E_ARGUMENT, "argument '%.80s' is not taken; see --help", text)
               : umb_fail(error, UMB_E_ARGUMENT,
                          "argument '%.80s' is one too many; give at most %zu; see --help", text,
                          words);
}

/* Finds "--name", "--name=value", "-o" or "-ovalue". Out: value: the attached value, or NULL. */
static bool find_option(const struct umbu_command *command, const char *text,
                        struct umbu_row *found, const char **value)
{
    if (text[1] != '-') {
        *value = text[2] != '\0' ? text + 2 : NULL;
        return text[2] != '=' && find_letter(command, text[1], found);
    }
    const size_t length = strcspn(text + 2, "=");
    *value = text[2 + length] == '=' ? text + 2 + length + 1 : NULL;
    return find_name(command, text + 2, length, found) && !umbu_is_word(found->option);
}

/* Takes the option at argv[*at]. Out: at: index of the value, if it is the next argument. */
static enum umb_status take_option(struct umbu_parsed *parsed, int argc, char **argv, int *at,
                                   struct umb_error *error)
{
    struct umbu_row found;
    const char *value;
    if (!find_option(parsed->command, argv[*at], &found, &value)) {
        return umb_fail(error, UMB_E_ARGUMENT, "option '%.80s' is not known; see --help",
                        argv[*at]);
    }
    if (found.option->value == NULL && found.option->choices == NULL) {
        return value == NULL ? take_value(parsed, &found, "true", error)
                             : umb_fail(error, UMB_E_ARGUMENT, "--%s: takes no value, but has one",
                                        found.option->name);
    }
    if (value == NULL && *at + 1 < argc) {
        value = argv[++*at];
    }
    if (value == NULL) {
        char expects[160];
        umbu_expects(found.option, expects, sizeof expects);
        return umb_fail(error, UMB_E_ARGUMENT, "--%s: needs a value; give %s", found.option->name,
                        expects);
    }
    return take_value(parsed, &found, value, error);
}

enum umb_status umbu_take_arguments(struct umbu_parsed *parsed, int argc, char **argv,
                                    struct umb_error *error)
{
    bool options_over = false;
    parsed->source++;
    for (int at = 1; at < argc && parsed->alone == NULL && !parsed->help; at++) {
        const char *text = argv[at];
        if (options_over || text[0] != '-' || text[1] == '\0') {
            UMB__TRY(take_word(parsed, text, error));
        } else if (strcmp(text, "--") == 0) {
            options_over = true;
        } else if (strcmp(text, "--help") == 0 || strcmp(text, "-h") == 0) {
            parsed->help = true;
        } else {
            UMB__TRY(take_option(parsed, argc, argv, &at, error));
        }
    }
    return UMB_OK;
}

enum umb_status umbu_take_setting(struct umbu_parsed *parsed, const char *name, const char *value,
                                  struct umb_error *error)
{
    struct umbu_row found;
    parsed->source = parsed->source == 0 ? 1 : parsed->source;
    if (!find_name(parsed->command, name, strlen(name), &found) || found.option->not_in_file ||
        umbu_is_word(found.option)) {
        return umb_fail(error, UMB_E_ARGUMENT, "setting '%.60s' is not known", name);
    }
    if (parsed->given[found.index] == parsed->source && found.option->kind != UMBU_KIND_LIST) {
        return umb_fail(error, UMB_E_ARGUMENT, "'%s' is given twice; give it once", name);
    }
    return take_value(parsed, &found, value, error);
}

/* Finds the word of a choice that a setting has. */
static size_t chosen(const struct umbu_parsed *parsed, const struct umbu_row *found,
                     const char **word)
{
    if (found->option->type == UMBU_TYPE_TEXT) {
        memcpy(word, field_of(parsed, found), sizeof *word);
        return *word != NULL ? strlen(*word) : 0;
    }
    return umbu_choice(found->option->choices,
                       (size_t)umbu_get_integer(found->option, field_of(parsed, found)), word);
}

/* True if "camera|path" or "filter=tent|box" (length bytes) holds. */
static bool holds(const struct umbu_parsed *parsed, const char *text, size_t length)
{
    struct umbu_row found = {0};
    const char *equals = memchr(text, '=', length);
    if (equals != NULL) {
        const char *word = "";
        const size_t before = (size_t)(equals - text) + 1;
        if (!find_name(parsed->command, text, before - 1, &found)) {
            abort();
        }
        const size_t word_length = chosen(parsed, &found, &word);
        return umbu_is_among(equals + 1, length - before, word, word_length);
    }
    while (umbu_next_row(parsed->command, &found)) {
        if (parsed->given[found.index] != 0 &&
            umbu_is_among(text, length, found.option->name, strlen(found.option->name))) {
            return true;
        }
    }
    return false;
}

/* Writes "camera|path" as "--camera or --path", "filter=tent|box" as "--filter tent or box". */
static void condition_text(const char *condition, size_t length, char *text, size_t size)
{
    const bool named = memchr(condition, '=', length) != NULL;
    size_t used = (size_t)snprintf(text, size, "--");
    for (size_t i = 0; i < length && used + 8 < size; i++) {
        if (condition[i] == '|') {
            used += (size_t)snprintf(text + used, size - used, named ? " or " : " or --");
        } else {
            text[used++] = condition[i] == '=' ? ' ' : condition[i];
        }
    }
    text[used] = '\0';
}

/* Checks the conditions of an option that was given: all of them must hold if `wanted`, none of
 * them may hold otherwise. */
static enum umb_status check_row(const struct umbu_parsed *parsed, const struct umbu_option *option,
                                 const char *conditions, bool wanted, struct umb_error *error)
{
    for (const char *at = conditions; at != NULL && *at != '\0';) {
        const size_t length = strcspn(at, " ");
        if (holds(parsed, at, length) != wanted) {
            char text[120];
            condition_text(at, length, text, sizeof text);
            return wanted ? umb_fail(error, UMB_E_ARGUMENT, "--%s: needs %s", option->name, text)
                          : umb_fail(error, UMB_E_ARGUMENT, "--%s: does not go with %s; give one",
                                     option->name, text);
        }
        at += length + (at[length] == ' ');
    }
    return UMB_OK;
}

enum umb_status umbu_check(const struct umbu_parsed *parsed, struct umb_error *error)
{
    struct umbu_row found = {0};
    if (parsed->help || parsed->alone != NULL) {
        return UMB_OK;
    }
    while (umbu_next_row(parsed->command, &found)) {
        const struct umbu_option *option = found.option;
        if (parsed->given[found.index] == 0) {
            if (option->needed) {
                return umb_fail(error, UMB_E_ARGUMENT, "%s%s: is needed; see --help",
                                umbu_is_word(option) ? "" : "--", option->name);
            }
            continue;
        }
        UMB__TRY(check_row(parsed, option, option->needs, true, error));
        UMB__TRY(check_row(parsed, option, option->excludes, false, error));
    }
    return UMB_OK;
}

enum umb_status umbu_parse(struct umbu_parsed *parsed, const struct umbu_command *command, int argc,
                           char **argv, void *settings, struct umb_error *error)
{
    umbu_begin(parsed, command, settings);
    UMB__TRY(umbu_take_arguments(parsed, argc, argv, error));
    return umbu_check(parsed, error);
}

int umbu_end(const struct umbu_command *command, enum umb_status status,
             const struct umb_error *error)
{
    if (status != UMB_OK) {
        (void)fprintf(stderr, "%s: %s\n", command->name,
                      error->message[0] != '\0' ? error->message : umb_status_text(status));
    }
    return umbu_exit_code(status);
}

/* Exit code of a command that only printed. */
static int end_of_print(void)
{
    return umbu_exit_code(fflush(stdout) != 0 || ferror(stdout) ? UMB_E_IO : UMB_OK);
}

int umbu_start(struct umbu_parsed *parsed, const struct umbu_command *command, int argc,
               char **argv, void *settings)
{
    struct umb_error error;
    if (argc == 2 && strcmp(argv[1], "--print-options") == 0) {
        umbu_print_rows(command, stdout);
        return end_of_print();
    }
    const enum umb_status status = umbu_parse(parsed, command, argc, argv, settings, &error);
    if (status != UMB_OK) {
        return umbu_end(command, status, &error);
    }
    if (!parsed->help) {
        return -1;
    }
    umbu_print_help(command, stdout);
    return end_of_print();
}

bool umbu_given(const struct umbu_parsed *parsed, const char *name)
{
    struct umbu_row found;
    if (!find_name(parsed->command, name, strlen(name), &found)) {
        abort();
    }
    return parsed->given[found.index] != 0;
}

void umbu_name_options(const struct umbu_command *command, struct umb_error *error)
{
    char named[sizeof error->message] = "";
    const char *rest = error->message;
    size_t used = 0;
    for (;;) {
        const size_t length = strspn(rest, "abcdefghijklmnopqrstuvwxyz_");
        struct umbu_row found = {0};
        bool known = false;
        while (!known && (rest[length] == ':' || rest[length] == ',') &&
               umbu_next_row(command, &found)) {
            known = found.option->fields != NULL &&
                    umbu_is_among(found.option->fields, strlen(found.option->fields), rest, length);
        }
        if (!known) {
            break;
        }
        const bool more = strncmp(rest + length, ", ", 2) == 0;
        used += (size_t)snprintf(named + used, sizeof named - used, "--%s%s", found.option->name,
                                 more ? ", " : "");
        rest += length + (more ? 2 : 0);
        if (!more || used + 64 > sizeof named) {
            break;
        }
    }
    if (used > 0) {
        (void)snprintf(named + used, sizeof named - used, "%s", rest);
        memcpy(error->message, named, sizeof named);
    }
}
