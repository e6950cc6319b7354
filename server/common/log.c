/* SPDX-License-Identifier: Apache-2.0 */
/* The daemon's log: key=value lines, each in one write. A failure of the log never reaches the
 * caller. */
#include "common/log.h"
#include "tool/clock.h"

#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define QUOTED_MAX 128 /* bytes of foreign text kept in one value */

static const char *const level_names[] = {"error", "warn", "info", "debug"};

void umbs_log_init(struct umbs_log *log, int fd, enum umb_log_level level)
{
    log->fd = fd;
    atomic_store(&log->level, (int)level);
    log->format = UMBS_LOG_TEXT;
}

void umbs_log_set_level(struct umbs_log *log, enum umb_log_level level)
{
    atomic_store(&log->level, (int)level);
}

/* Adds the length that vsnprintf returned, capped at the room. */
static size_t clamp(int written, size_t room)
{
    if (written < 0) {
        return 0;
    }
    return (size_t)written < room ? (size_t)written : room - 1;
}

/* --- key=value as JSON; source of the escapes: RFC 8259, section 7 --- */

struct json_line {
    char *out;
    size_t length, capacity;
    int full;
};

static void put(struct json_line *json, const char *text, size_t length)
{
    /* The last byte is kept for the closing brace. */
    if (json->full || length >= json->capacity - json->length) {
        json->full = 1;
        return;
    }
    memcpy(json->out + json->length, text, length);
    json->length += length;
}

/* Writes one character of a value; a byte that is not printable ASCII becomes \u00NN. */
static void put_character(struct json_line *json, unsigned char c)
{
    char text[8];
    if (c == '"' || c == '\\') {
        text[0] = '\\';
        text[1] = (char)c;
        put(json, text, 2);
    } else if (c < 0x20 || c > 0x7e) {
        put(json, text, (size_t)snprintf(text, sizeof text, "\\u%04x", c));
    } else {
        put(json, (const char *)&c, 1);
    }
}

static int hex_digit(char c)
{
    return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

/* Writes the rest of a quoted value, after its opening quote. Returns the text after the closing
 * quote. */
static const char *put_quoted(struct json_line *json, const char *at)
{
    put(json, "\"", 1);
    for (; *at != '\0' && *at != '"'; at++) {
        if (at[0] == '\\' && at[1] == 'x' && hex_digit(at[2]) >= 0 && hex_digit(at[3]) >= 0) {
            put_character(json, (unsigned char)(hex_digit(at[2]) * 16 + hex_digit(at[3])));
            at += 3;
        } else {
            put_character(json, (unsigned char)*at);
        }
    }
    put(json, "\"", 1);
    return *at == '"' ? at + 1 : at;
}

/* Returns true for a JSON number: an optional sign, digits without a leading zero, an optional
 * fraction. */
static int is_number(const char *text, size_t length)
{
    size_t at = length > 0 && text[0] == '-';
    size_t digits = strspn(text + at, "0123456789");
    if (digits == 0 || at + digits > length || (digits > 1 && text[at] == '0')) {
        return 0;
    }
    at += digits;
    if (at < length && text[at] == '.') {
        size_t fraction = strspn(text + at + 1, "0123456789");
        at += fraction > 0 ? 1 + fraction : 0;
    }
    return at == length;
}

static const char *put_bare(struct json_line *json, const char *at)
{
    size_t length = strcspn(at, " ");
    if (is_number(at, length)) {
        put(json, at, length);
        return at + length;
    }
    put(json, "\"", 1);
    for (size_t i = 0; i < length; i++) {
        put_character(json, (unsigned char)at[i]);
    }
    put(json, "\"", 1);
    return at + length;
}

size_t umbs__log_json(const char *line, char *out, size_t capacity)
{
    struct json_line json = {.out = out, .capacity = capacity};
    size_t kept = 1;
    put(&json, "{", 1);
    while (*line != '\0') {
        size_t key = strcspn(line, "= ");
        if (line[key] != '=' || key == 0) { /* not a pair: skipped */
            line += key + (line[key] != '\0');
            continue;
        }
        put(&json, ",\"", kept > 1 ? 2 : 0);
        put(&json, "\"", kept > 1 ? 0 : 1);
        put(&json, line, key);
        put(&json, "\":", 2);
        line += key + 1;
        line = *line == '"' ? put_quoted(&json, line + 1) : put_bare(&json, line);
        kept = json.full ? kept : json.length;
    }
    out[kept] = '}';
    return kept + 1;
}

void umbs_log_event(const struct umbs_log *log, enum umb_log_level level, const char *event,
                    const char *format, ...)
{
    if (log == NULL || log->fd < 0 || (int)level > atomic_load(&log->level)) {
        return;
    }
    char line[UMBS_LOG_LINE_MAX];
    size_t room = sizeof line - 1; /* the last byte is kept for the newline */
    const int64_t now_ms = umbu_unix_ms();
    const time_t now_s = (time_t)(now_ms / 1000);
    struct tm utc;
    if (gmtime_r(&now_s, &utc) == NULL) {
        memset(&utc, 0, sizeof utc);
    }
    size_t length = strftime(line, room, "ts=%Y-%m-%dT%H:%M:%S", &utc);
    length += clamp(snprintf(line + length, room - length, ".%03dZ level=%s event=%s",
                             (int)(now_ms % 1000), level_names[level], event),
                    room - length);
    if (format != NULL) {
        length += clamp(snprintf(line + length, room - length, " "), room - length);
        va_list arguments;
        va_start(arguments, format);
        length += clamp(vsnprintf(line + length, room - length, format, arguments), room - length);
        va_end(arguments);
    }
    char json[UMBS_LOG_LINE_MAX * 2];
    const char *out = line;
    if (log->format == UMBS_LOG_JSON) {
        line[length] = '\0';
        length = umbs__log_json(line, json, sizeof json - 1);
        json[length++] = '\n';
        out = json;
    } else {
        line[length++] = '\n';
    }
    /* A failed write of the log cannot be reported: the event is lost, and the daemon continues. */
    ssize_t ignored = write(log->fd, out, length);
    (void)ignored;
}

const char *umbs_log_quote(const char *text, char out[UMBS_LOG_QUOTE_SIZE])
{
    static const char digits[] = "0123456789abcdef";
    size_t at = 0;
    out[at++] = '"';
    for (size_t i = 0; text[i] != '\0' && i < QUOTED_MAX; i++) {
        unsigned char c = (unsigned char)text[i];
        if (c >= 0x20 && c <= 0x7e && c != '"' && c != '\\') {
            out[at++] = (char)c;
        } else {
            out[at++] = '\\';
            out[at++] = 'x';
            out[at++] = digits[c >> 4];
            out[at++] = digits[c & 15];
        }
    }
    out[at++] = '"';
    out[at] = '\0';
    return out;
}
