/* SPDX-License-Identifier: Apache-2.0 */
/* Keys with numbers, see keys.h. */
#include "tool/keys.h"

#include <math.h>
#include <string.h>

#include "tool/options.h"

/* Finds the key whose name and '=' are at `at`; NULL if there is none. */
static const struct umbu_key *find_key(const char *at, const struct umbu_key *keys, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const size_t length = strlen(keys[i].name);
        if (strncmp(at, keys[i].name, length) == 0 && at[length] == '=') {
            return &keys[i];
        }
    }
    return NULL;
}

/* Reads the numbers of a key; *at moves behind them. */
static enum umb_status read_key(const char *option, const struct umbu_key *key, const char **at,
                                struct umb_error *error)
{
    if (*key->given) {
        return umb_fail(error, UMB_E_ARGUMENT, "%s: %s is given twice", option, key->name);
    }
    *key->given = true;
    *at += strlen(key->name) + 1;
    for (unsigned i = 0; i < key->count; i++) {
        if (i > 0 && *(*at)++ != ',') {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: %s needs %u numbers, has %u", option,
                            key->name, key->count, i);
        }
        const char *from = *at;
        if (!umbu_read_number(at, &key->values[i]) || fabs(key->values[i]) > key->limit) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: %s: '%.40s' is not a number from -%g to %g",
                            option, key->name, from, key->limit, key->limit);
        }
    }
    return UMB_OK;
}

enum umb_status umbu_read_keys(const char *option, const char *text, const char *forms,
                               const struct umbu_key *keys, size_t count, struct umb_error *error)
{
    const char *at = text;
    for (;;) {
        const struct umbu_key *key = find_key(at, keys, count);
        if (key == NULL) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.40s' is none of %s", option, at, forms);
        }
        const enum umb_status status = read_key(option, key, &at, error);
        if (status != UMB_OK || *at == '\0') {
            return status;
        }
        if (*at++ != ',') {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: '%.40s' where a comma was expected", option,
                            at - 1);
        }
    }
}
