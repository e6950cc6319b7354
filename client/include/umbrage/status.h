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
 * Threads: everything here is a pure function of its arguments.
 * Stability: values are pinned for ever; new ones are added at the end of their group.
 */
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_API __attribute__((visibility("default")))
#define UMB_CHECKED __attribute__((warn_unused_result))
#define UMB_PRINTF(format_index, first_index)                                                      \
    __attribute__((format(printf, format_index, first_index)))

/*
 * X(name, value, text, gRPC code, process exit code). One list makes the enum, the names, the
 * texts and both mappings, so that they cannot drift apart.
 */
#define UMB_STATUS_LIST(X)                                                                         \
    X(OK, 0, "ok", 0, 0)                                                                           \
    /* the caller's mistake */                                                                     \
    X(E_ARGUMENT, -1, "invalid argument", 3, 2)                                                    \
    X(E_NOT_FOUND, -2, "not found", 5, 66)                                                         \
    X(E_TOO_LARGE, -3, "over a limit", 8, 2)                                                       \
    X(E_UNSUPPORTED, -4, "not supported", 12, 69)                                                  \
    X(E_PERMISSION, -5, "permission denied", 7, 77)                                                \
    X(E_UNAUTHENTICATED, -6, "not authenticated", 16, 77)                                          \
    X(E_EXISTS, -7, "already exists", 6, 73)                                                       \
    X(E_STATE, -8, "not possible in this state", 9, 70)                                            \
    /* bytes that are not what they should be */                                                   \
    X(E_FORMAT, -20, "not an umbrage file", 15, 65)                                                \
    X(E_VERSION, -21, "unknown format version", 12, 65)                                            \
    X(E_TRUNCATED, -22, "file ends too early", 15, 65)                                             \
    X(E_CORRUPT, -23, "file is damaged", 15, 65)                                                   \
    X(E_BAD_SCENE, -24, "scene cannot be used", 3, 65)                                             \
    /* resources */                                                                                \
    X(E_NO_MEMORY, -40, "out of memory", 8, 75)                                                    \
    X(E_BUSY, -41, "too busy", 8, 75)                                                              \
    X(E_IO, -42, "input or output failed", 13, 74)                                                 \
    X(E_NO_INPUT, -43, "cannot open input", 5, 66)                                                 \
    X(E_CANNOT_CREATE, -44, "cannot create output", 13, 73)                                        \
    X(E_LIMIT, -45, "a resource limit was reached", 8, 75)                                         \
    /* transport */                                                                                \
    X(E_UNAVAILABLE, -60, "service unavailable", 14, 69)                                           \
    X(E_DEADLINE, -61, "deadline exceeded", 4, 75)                                                 \
    X(E_CANCELLED, -62, "cancelled", 1, 75)                                                        \
    X(E_PROTOCOL, -63, "protocol violation", 13, 70)                                               \
    /* our own bug */                                                                              \
    X(E_INTERNAL, -80, "internal error", 13, 70)

enum umb_status {
#define UMB_STATUS_ENUM(name, value, text, grpc, exit_code) UMB_##name = (value),
    UMB_STATUS_LIST(UMB_STATUS_ENUM)
#undef UMB_STATUS_ENUM
};

/* Detail of one failure; lives with the caller, holds no pointers, needs no destroy. */
struct umb_error {
    enum umb_status status; /* the code the function also returned */
    int system_error;       /* errno of the failing system call, or 0 */
    char message[320];      /* one sentence, UTF-8, no newline: field, value, limit */
};

/* Returns the symbolic name ("E_CORRUPT"), never NULL. */
UMB_API const char *umb_status_name(enum umb_status status);

/* Returns a short text ("file is damaged"), never NULL. */
UMB_API const char *umb_status_text(enum umb_status status);

/* Returns the gRPC status code (0..16) that stands for the status on the wire. */
UMB_API int umb_status_grpc(enum umb_status status);

/*
 * Returns the status that stands for a gRPC code a server sent (0..16; others E_PROTOCOL).
 * RESOURCE_EXHAUSTED alone is E_TOO_LARGE: asking the same again does not help. A reply that also
 * says when to come again (grpc-retry-pushback-ms) means E_BUSY; libumbrage looks at that.
 */
UMB_API enum umb_status umb_status_from_grpc(int grpc_code);

/* Returns the process exit code (docs/reference/operations.md, "Exit codes"). */
UMB_API int umb_status_exit(enum umb_status status);

/*
 * Fills error (if not NULL) and returns status, so that `return umb_fail(...)` reads well.
 *
 * In:  format: printf format of one sentence; cut at 319 bytes. Control characters become blanks,
 *      malformed UTF-8 '?', so that what a stranger wrote may be put in. system_error is set to 0.
 */
UMB_API enum umb_status umb_fail(struct umb_error *error, enum umb_status status,
                                 const char *format, ...) UMB_PRINTF(3, 4);

/* The same with the errno of a failed system call; its text is appended to the message. */
UMB_API enum umb_status umb_fail_errno(struct umb_error *error, enum umb_status status,
                                       int system_error, const char *format, ...)
    UMB_PRINTF(4, 5);

#ifdef __cplusplus
}
#endif
#endif
