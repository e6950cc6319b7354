/* SPDX-License-Identifier: Apache-2.0 */
/* The daemon's log: key=value lines, each in one write. Never fails its caller. */
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
    /* A failed write of the log cannot be reported: the event is lost, the daemon goes on. */
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
