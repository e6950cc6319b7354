/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_option_names.h. */
#include "cli_option_names.h"

#include <string.h>

#include "cli_common.h"

static const struct {
    const char *field, *option;
} NAMES[] = {
    {"bias", "--bias"},           {"bias_mode", "--bias"},
    {"budget", "--budget"},       {"filter", "--filter"},
    {"footprint", "--footprint"}, {"footprint_m", "--footprint"},
    {"format", "--encoding"},     {"level", "--level"},
    {"light", "--light"},         {"light_extent", "--light-size"},
    {"max_error", "--max-error"}, {"max_visibility", "--max-error"},
    {"taps", "--taps"},
};

/* The option of the field that text begins with, or NULL; *length: of the field. */
static const char *option_of(const char *text, size_t *length)
{
    *length = strspn(text, "abcdefghijklmnopqrstuvwxyz_");
    if (text[*length] != ':' && text[*length] != ',') {
        return NULL;
    }
    for (size_t i = 0; i < sizeof NAMES / sizeof NAMES[0]; i++) {
        if (strlen(NAMES[i].field) == *length && strncmp(NAMES[i].field, text, *length) == 0) {
            return NAMES[i].option;
        }
    }
    return NULL;
}

void umbc_name_options(struct umb_error *error)
{
    char named[sizeof error->message] = "";
    const char *rest = error->message;
    size_t used = 0, length;
    const char *option = option_of(rest, &length);
    while (option != NULL && used + strlen(option) + 2 < sizeof named) {
        const int more = strncmp(rest + length, ", ", 2) == 0;
        used +=
            (size_t)snprintf(named + used, sizeof named - used, "%s%s", option, more ? ", " : "");
        rest += length + (more ? 2 : 0);
        option = more ? option_of(rest, &length) : NULL;
    }
    if (used > 0) {
        (void)snprintf(named + used, sizeof named - used, "%s", rest);
        memcpy(error->message, named, sizeof named);
    }
}

int umbc_complain_query(const struct umb_error *error)
{
    struct umb_error named = *error;
    umbc_name_options(&named);
    return umbc_complain(&named);
}
