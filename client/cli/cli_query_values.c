/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_query_values.h. */
#include "cli_query_values.h"

#include <string.h>
#include "cli_common.h"

int umbc_take_vector(const char *option, const char *text, double vector[3])
{
    char copy[128];
    size_t length = strlen(text);
    char *at = copy;
    if (length < sizeof copy) {
        memcpy(copy, text, length + 1);
        for (int axis = 0; axis < 3; axis++) {
            char *comma = strchr(at, ',');
            if ((comma == NULL) != (axis == 2)) {
                break;
            }
            if (comma != NULL) {
                *comma = '\0';
            }
            if (!umbc_parse_number(at, &vector[axis])) {
                break;
            }
            if (axis == 2) {
                return -1;
            }
            at = comma + 1;
        }
    }
    return umbc_usage_error("query: --%s '%s' is not three finite numbers X,Y,Z", option, text);
}

int umbc_take_bias(const char *text, struct umb_query_settings *settings)
{
    char copy[64];
    size_t length = strlen(text);
    if (strcmp(text, "auto") == 0) {
        settings->bias_mode = UMB_BIAS_AUTO;
        return -1;
    }
    if (strcmp(text, "none") == 0) {
        settings->bias_mode = UMB_BIAS_NONE;
        return -1;
    }
    if (length < sizeof copy) {
        memcpy(copy, text, length + 1);
        if (length > 3 && strcmp(copy + length - 3, "vox") == 0) {
            copy[length - 3] = '\0';
            settings->bias_mode = UMB_BIAS_VOXELS;
        } else if (length > 1 && copy[length - 1] == 'm') {
            copy[length - 1] = '\0';
            settings->bias_mode = UMB_BIAS_METRES;
        } else {
            copy[0] = '\0';
        }
        if (umbc_parse_number(copy, &settings->bias)) {
            return -1;
        }
    }
    return umbc_usage_error("query: --bias '%s' is not auto, none, or a length as 1.5vox or 0.02m",
                            text);
}

bool umbc_take_amount(const char *text, const char *const endings[2], double *value, int *which)
{
    char copy[64];
    const size_t length = strlen(text);
    *which = 0;
    if (length >= sizeof copy) {
        return false;
    }
    memcpy(copy, text, length + 1);
    for (int i = 0; i < 2 && *which == 0; i++) {
        const size_t ending = strlen(endings[i]);
        if (length > ending && strcmp(copy + length - ending, endings[i]) == 0) {
            copy[length - ending] = '\0';
            *which = i + 1;
        }
    }
    return umbc_parse_number(copy, value) && *value > 0;
}
