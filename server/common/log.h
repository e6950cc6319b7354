/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_COMMON_LOG_H
#define UMBRAGE_SERVER_COMMON_LOG_H
/*
 * The log of the daemon: one `key=value` line an event, to a file descriptor (stderr).
 *
 *     ts=2026-01-31T12:00:00.123Z level=info event=listening address="tcp:127.0.0.1:7420"
 *     {"ts":"2026-01-31T12:00:00.123Z","level":"info","event":"listening","address":"..."}
 *
 * Life: umbs_log_init, then umbs_log_event from any thread; nothing to destroy.
 * Threads: a line is formatted on the caller's stack and leaves in one write(2), so lines of
 * different threads do not mix. Only the level may change after init.
 * Trust: text that comes from outside goes through umbs_log_quote, which escapes and caps it.
 */
#include <stddef.h>
#include "umbrage/log.h"
#include "umbrage/status.h"

#define UMBS_LOG_LINE_MAX 2048 /* bytes of a line; longer ones are cut */
/* Bytes for any quoted value: 128 bytes as \xNN, quotes and NUL. */
#define UMBS_LOG_QUOTE_SIZE 520

enum umbs_log_format {
    UMBS_LOG_TEXT = 0, /* key=value */
    UMBS_LOG_JSON,     /* one object a line, the same keys */
};

struct umbs_log {
    int fd;                      /* -1 = silent */
    _Atomic int level;           /* enum umb_log_level; events above it are dropped */
    enum umbs_log_format format; /* read-only after init */
};

void umbs_log_init(struct umbs_log *log, int fd, enum umb_log_level level);

/*
 * Writes one event.
 *
 * In:    log: NULL writes nothing. event: a word. format: printf format of the `key=value` pairs
 *        after the event, or NULL. Values from outside must have been quoted by umbs_log_quote.
 */
void umbs_log_event(const struct umbs_log *log, enum umb_log_level level, const char *event,
                    const char *format, ...) UMB_PRINTF(4, 5);

/* Quotes text: at most 128 bytes of text, with control bytes, quotes and bytes above 0x7e as \xNN.
 * Returns out, which has UMBS_LOG_QUOTE_SIZE bytes. */
const char *umbs_log_quote(const char *text, char out[UMBS_LOG_QUOTE_SIZE]);

/* Changes the level; any thread, at once. */
void umbs_log_set_level(struct umbs_log *log, enum umb_log_level level);

/*
 * Turns `key=value key="quoted \xNN"` into one JSON object. A bare value that is a plain decimal
 * number stays a number; every other value becomes a string. If a pair does not fit into out, that
 * pair and all later ones are left out.
 *
 * In:    line: NUL-terminated, as umbs_log_event makes it. capacity: bytes of out, at least 3.
 * Returns the length of the object, which has no terminating NUL.
 */
size_t umbs__log_json(const char *line, char *out, size_t capacity);

#endif
