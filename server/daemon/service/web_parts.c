/* SPDX-License-Identifier: Apache-2.0 */
/* See web_parts.h. */
#include "daemon/service/web_parts.h"

#include <string.h>

#define BEGIN "/assets/"
#define IDS   "by-id/"
#define END   ".umb"

static int is_name_byte(char c)
{
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           (c != '\0' && strchr("._-/", c) != NULL);
}

static int is_id_byte(char c)
{
    return (c >= 'a' && c <= 'f') || (c >= '0' && c <= '9');
}

/* Removes a prefix; returns 0 if the text does not begin with it. */
static int skip(struct umbn_http1_text *text, const char *prefix)
{
    const size_t length = strlen(prefix);
    if (text->size < length || memcmp(text->bytes, prefix, length) != 0) {
        return 0;
    }
    text->bytes += length;
    text->size -= length;
    return 1;
}

int umbd_web_route(struct umbn_http1_text path, struct umbd_web_route *route)
{
    const size_t end = strlen(END);
    if (!skip(&path, BEGIN) || path.size <= end ||
        memcmp(path.bytes + path.size - end, END, end) != 0) {
        return 0;
    }
    path.size -= end;
    route->by_id = skip(&path, IDS);
    if (path.size == 0 || path.size > UMBS_STORE_NAME_MAX ||
        (route->by_id && path.size != UMB_ID_TEXT_SIZE - 1)) {
        return 0;
    }
    for (size_t i = 0; i < path.size; i++) {
        if (!(route->by_id ? is_id_byte(path.bytes[i]) : is_name_byte(path.bytes[i]))) {
            return 0;
        }
    }
    memcpy(route->asset, path.bytes, path.size);
    route->asset[path.size] = '\0';
    return 1;
}
