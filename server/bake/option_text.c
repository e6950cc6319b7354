/* SPDX-License-Identifier: Apache-2.0 */
/* Reading words of the command line. */
#include "bake/option_text.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum umb_status umbb_option_refuse(struct umb_error *error, const char *option, const char *value,
                                   const char *limit)
{
    return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.64s' is not %s", option, value, limit);
}

int umbb_option_count(const char *text, const char **rest, uint64_t *value)
{
    uint64_t number = 0;
    const char *at = text;
    for (; *at >= '0' && *at <= '9'; at++) {
        if (__builtin_mul_overflow(number, (uint64_t)10, &number) ||
            __builtin_add_overflow(number, (uint64_t)(*at - '0'), &number)) {
            return 0;
        }
    }
    *rest = at;
    *value = number;
    return at != text;
}

int umbb_option_number(const char *text, const char **rest, double *value)
{
    char *end;
    if (strchr("+-.0123456789", text[0]) == NULL || text[0] == '\0') {
        return 0;
    }
    errno = 0;
    *value = strtod(text, &end);
    *rest = end;
    return end != text && isfinite(*value) &&
           memchr(text, 'x', (size_t)(end - text)) == NULL && /* strtod reads 0x10 as 16 */
           memchr(text, 'X', (size_t)(end - text)) == NULL;
}
