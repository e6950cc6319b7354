/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_STATUS_H
#define UMBRAGE_STATUS_H
/*
 * Status codes, and the caller-owned detail that goes with them.
 *
 * Every function that can fail returns an enum umb_status and nothing else; results travel in
 * trailing out-parameters, which are NULL or zero after a failure. There is no errno contract and
 * no hidden last error. Slow paths also take a struct umb_error (may be NULL) and fill it with one
 * sentence that names the field, the value and the limit.
 *
 * A missing thing is UMB_E_NOT_FOUND. A function that returns int answers a yes-or-no question. A
 * function with `get` in its name fills in the caller's struct or array; a function without it
 * returns its result.
 *
 * Threads: everything here is a pure function of its arguments.
 * Stability: stable; umbrage/version.h says what that means. New codes come at the end of their
 *        group.
 */
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_API     __attribute__((visibility("default")))
#define UMB_CHECKED __attribute__((warn_unused_result))
#define UMB_PRINTF(format_index, first_index)                                                      \
    __attribute__((format(printf, format_index, first_index)))

/*
 * X(name, value, text). The enum, the names and the texts are made from this one list.
 */
#define UMB_STATUS_LIST(X)                                                                         \
    X(OK, 0, "ok")                                                                                 \
    /* the caller's mistake */                                                                     \
    X(E_ARGUMENT, -1, "invalid argument")                                                          \
    X(E_NOT_FOUND, -2, "not found")                                                                \
    X(E_TOO_LARGE, -3, "over a limit")                                                             \
    X(E_UNSUPPORTED, -4, "not supported")                                                          \
    X(E_PERMISSION, -5, "permission denied")                                                       \
    X(E_UNAUTHENTICATED, -6, "not authenticated")                                                  \
    X(E_EXISTS, -7, "already exists")                                                              \
    X(E_STATE, -8, "not possible in this state")                                                   \
    /* bytes that are not what they should be */                                                   \
    X(E_FORMAT, -20, "not an umbrage file")                                                        \
    X(E_VERSION, -21, "unknown format version")                                                    \
    X(E_TRUNCATED, -22, "file ends too early")                                                     \
    X(E_CORRUPT, -23, "file is damaged")                                                           \
    X(E_BAD_SCENE, -24, "scene cannot be used")                                                    \
    /* resources */                                                                                \
    X(E_NO_MEMORY, -40, "out of memory")                                                           \
    X(E_BUSY, -41, "too busy")                                                                     \
    X(E_IO, -42, "input or output failed")                                                         \
    X(E_NO_INPUT, -43, "cannot open input")                                                        \
    X(E_CANNOT_CREATE, -44, "cannot create output")                                                \
    X(E_LIMIT, -45, "a resource limit was reached")                                                \
    /* transport */                                                                                \
    X(E_UNAVAILABLE, -60, "service unavailable")                                                   \
    X(E_DEADLINE, -61, "deadline exceeded")                                                        \
    X(E_CANCELLED, -62, "cancelled")                                                               \
    X(E_PROTOCOL, -63, "protocol violation")                                                       \
    /* our own bug */                                                                              \
    X(E_INTERNAL, -80, "internal error")

enum umb_status {
#define UMB_STATUS_ENUM(name, value, text) UMB_##name = (value),
    UMB_STATUS_LIST(UMB_STATUS_ENUM)
#undef UMB_STATUS_ENUM
};

/* Detail of one failure. The caller's storage, without pointers; nothing needs to be freed. */
struct umb_error {
    enum umb_status status; /* Code that the function also returned */
    int system_error;       /* errno of the failing system call, or 0 */
    char message[320];      /* One sentence, UTF-8, no newline: field, value, limit */
};

/* Returns the symbolic name ("E_CORRUPT"), never NULL. */
UMB_API const char *umb_status_name(enum umb_status status);

/* Returns a short text ("file is damaged"), never NULL. */
UMB_API const char *umb_status_text(enum umb_status status);

/*
 * Fills error (if not NULL) and returns status, so that `return umb_fail(...)` reads well.
 *
 * In:  format: printf format of one sentence; cut at 319 bytes. Control characters become blanks
 *      and malformed UTF-8 becomes '?', so untrusted text is safe in it.
 * Out: error: with system_error 0.
 */
UMB_API enum umb_status umb_fail(struct umb_error *error, enum umb_status status,
                                 const char *format, ...) UMB_PRINTF(3, 4);

/* Works as umb_fail, for a failed system call. The text of its errno is appended to the message. */
UMB_API enum umb_status umb_fail_errno(struct umb_error *error, enum umb_status status,
                                       int system_error, const char *format, ...) UMB_PRINTF(4, 5);

#ifdef __cplusplus
}
#endif
#endif
