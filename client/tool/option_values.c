/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Turns the text of an option's value into a field, or makes the sentence that refuses the text.
 *
 * Numbers are read under the "C" locale: no program calls setlocale.
 */
#include "tool/options.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NAME_SIZE 4096 /* bytes of a file name with its NUL */

static const struct unit {
    const char *name;
    uint64_t factor;
} BYTE_UNITS[] = {{"TiB", (uint64_t)1 << 40},
                  {"GiB", 1 << 30},
                  {"MiB", 1 << 20},
                  {"KiB", 1 << 10},
                  {"G", 1 << 30},
                  {"M", 1 << 20},
                  {"K", 1 << 10},
                  {"", 1}},
  TIME_UNITS[] = {{"m", 60000}, {"s", 1000}, {"ms", 1}, {"", 1000}};

bool umbu_is_word(const struct umbu_option *option)
{
    return option->name[0] >= 'A' && option->name[0] <= 'Z';
}

bool umbu_read_count(const char **text, uint64_t *value)
{
    const char *at = *text;
    uint64_t number = 0;
    for (; *at >= '0' && *at <= '9'; at++) {
        if (__builtin_mul_overflow(number, (uint64_t)10, &number) ||
            __builtin_add_overflow(number, (uint64_t)(*at - '0'), &number)) {
            return false;
        }
    }
    const bool found = at != *text;
    *text = at;
    *value = number;
    return found;
}

bool umbu_read_number(const char **text, double *value)
{
    /* strtod also takes blanks, "inf", "nan" and hexadecimal digits. */
    const size_t length = strspn(*text, "0123456789+-.eE");
    char *end = NULL;
    const double number = length > 0 && strchr("eE", **text) == NULL ? strtod(*text, &end) : 0;
    if (end == NULL || end == *text || end > *text + length || !isfinite(number)) {
        return false;
    }
    *text = end;
    *value = number;
    return true;
}

bool umbu_read_numbers(const char *text, size_t count, double *values)
{
    for (size_t i = 0; i < count; i++) {
        if ((i > 0 && *text++ != ',') || !umbu_read_number(&text, &values[i])) {
            return false;
        }
    }
    return *text == '\0';
}

uint64_t umbu_get_integer(const struct umbu_option *option, const void *field)
{
    switch (option->type) {
    case UMBU_TYPE_BOOL:
        return *(const bool *)field;
    case UMBU_TYPE_ULONG:
        return *(const unsigned long *)field;
    default:
        return *(const unsigned *)field;
    }
}

static bool put_integer(const struct umbu_option *option, uint64_t value, void *field)
{
    if (option->type == UMBU_TYPE_BOOL) {
        *(bool *)field = value != 0;
    } else if (option->type == UMBU_TYPE_ULONG) {
        *(unsigned long *)field = value;
    } else {
        *(unsigned *)field = (unsigned)value;
    }
    return true;
}

static bool put_text(const char *text, void *field)
{
    memcpy(field, &text, sizeof text);
    return true;
}

static bool put_number(const struct umbu_option *option, const char *text, void *field)
{
    double value;
    if (!umbu_read_number(&text, &value) ||
        (*text != '\0' && (option->unit == NULL || strcmp(text, option->unit) != 0)) ||
        value < option->low || value > option->high || (option->above && value <= option->low)) {
        return false;
    }
    if (option->type == UMBU_TYPE_INT) {
        *(int *)field = (int)value;
        return value == floor(value);
    }
    *(double *)field = option->scale != 0 ? value * option->scale : value;
    return true;
}

static bool put_count(const struct umbu_option *option, const char *text, void *field)
{
    uint64_t value;
    if (!umbu_read_count(&text, &value) || *text != '\0' || value < option->min ||
        value > option->max || (option->kind == UMBU_KIND_ODD && value % 2 == 0) ||
        (option->kind == UMBU_KIND_POWER && (value == 0 || (value & (value - 1)) != 0))) {
        return false;
    }
    return put_integer(option, option->as_log2 ? (uint64_t)__builtin_ctzll(value) : value, field);
}

static bool put_bytes(const struct umbu_option *option, const char *text, void *field)
{
    uint64_t value;
    const struct unit *unit = BYTE_UNITS;
    if (!umbu_read_count(&text, &value)) {
        return false;
    }
    while (strcmp(text, unit->name) != 0) {
        if (*unit++->name == '\0') {
            return false;
        }
    }
    return !__builtin_mul_overflow(value, unit->factor, &value) && value >= option->min &&
           value <= option->max && put_integer(option, value, field);
}

/* Stores a time: seconds in a double, whole milliseconds in an integer. */
static bool put_time(const struct umbu_option *option, const char *text, void *field)
{
    double value;
    const struct unit *unit = TIME_UNITS;
    if (!umbu_read_number(&text, &value)) {
        return false;
    }
    while (strcmp(text, unit->name) != 0) {
        if (*unit++->name == '\0') {
            return false;
        }
    }
    /* Decimal fractions are not exact in doubles (16.1 s is 16100.000000000002 ms), so values near
     * a whole number are rounded. */
    value *= (double)unit->factor;
    if (option->type != UMBU_TYPE_DOUBLE && fabs(value - nearbyint(value)) <= 1e-6) {
        value = nearbyint(value);
    }
    if (!(value >= (double)option->min && value <= (double)option->max) ||
        (option->above && value <= (double)option->min)) {
        return false;
    }
    if (option->type == UMBU_TYPE_DOUBLE) {
        *(double *)field = value / 1000;
        return true;
    }
    return value == floor(value) && put_integer(option, (uint64_t)value, field);
}

size_t umbu_choice(const char *choices, size_t index, const char **word)
{
    for (size_t i = 0; i < index; i++) {
        choices += strcspn(choices, "|");
        choices += *choices == '|';
    }
    *word = choices;
    return strcspn(choices, "|");
}

static bool put_choice(const struct umbu_option *option, const char *text, void *field)
{
    const size_t length = strlen(text);
    const char *word = option->choices, *end = option->choices + strlen(option->choices);
    for (size_t i = 0; word < end; i++) {
        const size_t word_length = umbu_choice(option->choices, i, &word);
        if (length > 0 && word_length == length && memcmp(word, text, length) == 0) {
            return option->type == UMBU_TYPE_TEXT ? put_text(text, field)
                                                  : put_integer(option, i, field);
        }
    }
    return false;
}

static bool put_sides(const struct umbu_option *option, const char *text, void *field)
{
    uint64_t width, height;
    if (!umbu_read_count(&text, &width) || *text++ != 'x' || !umbu_read_count(&text, &height) ||
        *text != '\0' || width < 1 || height < 1 || width > option->max || height > option->max ||
        (option->high > 0 && (double)width * (double)height > option->high)) {
        return false;
    }
    ((unsigned *)field)[0] = (unsigned)width;
    ((unsigned *)field)[1] = (unsigned)height;
    return true;
}

static bool put_mode(const struct umbu_option *option, const char *text, void *field)
{
    const size_t length = strspn(text, "01234567");
    const unsigned long mode = strtoul(text, NULL, 8);
    return length > 0 && length <= 4 && text[length] == '\0' && mode <= option->max &&
           (mode & option->min) == option->min && put_integer(option, mode, field);
}

/* Adds a text to a list that ends with NULL. */
static enum umb_status put_in_list(const struct umbu_option *option, const char *text, void *field,
                                   struct umb_error *error)
{
    const char **list = field;
    size_t count = 0;
    while (list[count] != NULL) {
        count++;
    }
    if (text[0] == '\0') {
        return umbu_refuse(option, text, error);
    }
    if (count == option->max) {
        return umb_fail(error, UMB_E_ARGUMENT, "--%s: '%.80s' is one too many; give at most %zu",
                        option->name, text, (size_t)option->max);
    }
    list[count] = text;
    list[count + 1] = NULL;
    return UMB_OK;
}

static bool put_flag(const struct umbu_option *option, const char *text, void *field)
{
    const bool on = strcmp(text, "true") == 0;
    return (on || strcmp(text, "false") == 0) && put_integer(option, on, field);
}

/* Reads a value of a kind that needs nothing but its row. */
static bool put(const struct umbu_option *option, const char *text, void *field)
{
    switch (option->kind) {
    case UMBU_KIND_FLAG:
        return put_flag(option, text, field);
    case UMBU_KIND_TEXT:
        return (text[0] != '\0' || option->may_be_empty) && put_text(text, field);
    case UMBU_KIND_NUMBER:
        return put_number(option, text, field);
    case UMBU_KIND_NUMBERS:
        return umbu_read_numbers(text, option->count, field);
    case UMBU_KIND_BYTES:
        return put_bytes(option, text, field);
    case UMBU_KIND_TIME:
        return put_time(option, text, field);
    case UMBU_KIND_CHOICE:
        return put_choice(option, text, field);
    case UMBU_KIND_SIDES:
        return put_sides(option, text, field);
    case UMBU_KIND_MODE:
        return put_mode(option, text, field);
    default:
        return put_count(option, text, field);
    }
}

enum umb_status umbu_read_value(const struct umbu_option *option, const char *text, void *field,
                                struct umb_error *error)
{
    if (option->kind == UMBU_KIND_READ) {
        return option->read(option, text, field, error);
    }
    if (option->kind == UMBU_KIND_LIST) {
        const enum umb_status status = option->read != NULL && text[0] != '\0'
                                           ? option->read(option, text, NULL, error)
                                           : UMB_OK;
        return status == UMB_OK ? put_in_list(option, text, field, error) : status;
    }
    return put(option, text, field) ? UMB_OK : umbu_refuse(option, text, error);
}

enum umb_status umbu_read_bias(const struct umbu_option *option, const char *text, void *field,
                               struct umb_error *error)
{
    struct umb_query_settings *settings = field;
    const char *at = text;
    double value = 0;
    if (strcmp(text, "auto") == 0 || strcmp(text, "none") == 0) {
        settings->bias_mode = text[0] == 'a' ? UMB_BIAS_AUTO : UMB_BIAS_NONE;
        return UMB_OK;
    }
    if (!umbu_read_number(&at, &value) || !(value >= 0 && value <= 1e6) ||
        (strcmp(at, "vox") != 0 && strcmp(at, "m") != 0)) {
        return umbu_refuse(option, text, error);
    }
    settings->bias_mode = *at == 'v' ? UMB_BIAS_VOXELS : UMB_BIAS_METRES;
    settings->bias = value;
    return UMB_OK;
}

enum umb_status umbu_read_name(const struct umbu_option *option, const char *text, void *field,
                               struct umb_error *error)
{
    return text[0] != '\0' && strcmp(text, "-") != 0 && strlen(text) < NAME_SIZE &&
                   put_text(text, field)
               ? UMB_OK
               : umbu_refuse(option, text, error);
}

enum umb_status umbu_refuse(const struct umbu_option *option, const char *text,
                            struct umb_error *error)
{
    char expects[200];
    umbu_expects(option, expects, sizeof expects);
    return umb_fail(error, UMB_E_ARGUMENT, "%s%s: '%.80s' is not valid; give %s",
                    umbu_is_word(option) ? "" : "--", option->name, text, expects);
}

/* Writes a value in the largest unit that divides it, at least `smallest`: "64MiB", "250ms". */
static void unit_text(const struct unit *units, const char *smallest, uint64_t value, char text[32])
{
    while (value == 0 || value % units->factor != 0) {
        if (strcmp(units->name, smallest) == 0) {
            break;
        }
        units++;
    }
    (void)snprintf(text, 32, "%llu%s", (unsigned long long)(value / units->factor), units->name);
}

/* Writes "text|f32|f64" as "text, f32 or f64". */
static void choices_text(const char *choices, char *text, size_t size)
{
    const char *word = choices, *end = choices + strlen(choices), *last = strrchr(choices, '|');
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; word < end && used < size; i++) {
        const size_t length = umbu_choice(choices, i, &word);
        if (length > 0) {
            used += (size_t)snprintf(text + used, size - used, "%s%.*s",
                                     used == 0                     ? ""
                                     : last != NULL && word > last ? " or "
                                                                   : ", ",
                                     (int)length, word);
        }
        word += length;
    }
}

static void number_text(const struct umbu_option *option, char *text, size_t size)
{
    const char *what = option->type == UMBU_TYPE_INT ? "a whole number" : "a number";
    char unit[40] = "";
    if (option->unit != NULL) {
        (void)snprintf(unit, sizeof unit, " (%s)", option->unit);
    }
    if (option->above && isinf(option->high)) {
        (void)snprintf(text, size, "%s above %g%s", what, option->low, unit);
    } else if (option->above) {
        (void)snprintf(text, size, "%s above %g and at most %g%s", what, option->low, option->high,
                       unit);
    } else if (isinf(option->low)) {
        (void)snprintf(text, size, "%s%s", what, unit);
    } else if (isinf(option->high)) {
        (void)snprintf(text, size, "%s of %g or more%s", what, option->low, unit);
    } else {
        (void)snprintf(text, size, "%s from %g to %g%s", what, option->low, option->high, unit);
    }
}

/* Writes "a size from 1KiB to 1GiB" or "a time from 1s to 10m". */
static void range_text(const struct umbu_option *option, char *text, size_t size)
{
    char low[32], high[32];
    if (option->kind == UMBU_KIND_BYTES) {
        unit_text(BYTE_UNITS, "", option->min, low);
        unit_text(BYTE_UNITS, "", option->max, high);
        (void)snprintf(text, size, "a size from %s to %s (bytes, KiB, MiB, GiB, TiB)", low, high);
    } else {
        unit_text(TIME_UNITS, "ms", option->min, low);
        unit_text(TIME_UNITS, "ms", option->max, high);
        (void)snprintf(text, size, "a time %s %s %s %s (ms, s, m; bare: seconds)",
                       option->above ? "above" : "from", low, option->above ? "and at most" : "to",
                       high);
    }
}

static void count_text(const struct umbu_option *option, char *text, size_t size)
{
    (void)snprintf(text, size, "%s from %llu to %llu",
                   option->kind == UMBU_KIND_ODD     ? "an odd number"
                   : option->kind == UMBU_KIND_POWER ? "a power of two"
                                                     : "a whole number",
                   (unsigned long long)option->min, (unsigned long long)option->max);
}

void umbu_expects(const struct umbu_option *option, char *text, size_t size)
{
    const char *value = option->value != NULL ? option->value : option->name;
    switch (option->kind) {
    case UMBU_KIND_FLAG:
        (void)snprintf(text, size, "true or false");
        break;
    case UMBU_KIND_TEXT:
    case UMBU_KIND_LIST:
        (void)snprintf(text, size, "%s, not empty", value);
        break;
    case UMBU_KIND_NUMBER:
        number_text(option, text, size);
        break;
    case UMBU_KIND_NUMBERS:
        (void)snprintf(text, size, "%u finite numbers %s", option->count, value);
        break;
    case UMBU_KIND_BYTES:
    case UMBU_KIND_TIME:
        range_text(option, text, size);
        break;
    case UMBU_KIND_CHOICE:
        choices_text(option->choices, text, size);
        break;
    case UMBU_KIND_SIDES:
        (void)snprintf(text, size, "WIDTHxHEIGHT, each from 1 to %llu",
                       (unsigned long long)option->max);
        if (option->high > 0) {
            const size_t used = strlen(text);
            (void)snprintf(text + used, size - used, ", together at most %.0f", option->high);
        }
        break;
    case UMBU_KIND_MODE:
        (void)snprintf(text, size, "an octal mode from %04llo to %04llo",
                       (unsigned long long)option->min, (unsigned long long)option->max);
        break;
    case UMBU_KIND_READ:
        (void)snprintf(text, size, "%s", option->expects);
        break;
    default:
        count_text(option, text, size);
        break;
    }
}
