/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_LOG_H
#define UMBRAGE_LOG_H
/*
 * The log callback of the libraries. They never write to stdout or stderr by themselves; without a
 * callback they are silent.
 * Stability: stable; umbrage/version.h says what that means.
 */

#ifdef __cplusplus
extern "C" {
#endif

enum umb_log_level {
    UMB_LOG_ERROR = 0, /* an operator must act */
    UMB_LOG_WARN = 1,  /* degraded */
    UMB_LOG_INFO = 2,  /* once in an object's life */
    UMB_LOG_DEBUG = 3, /* once a request */
};

/* message: one line, UTF-8, valid during the call only. May be called from the library's thread. */
typedef void (*umb_log_fn)(void *user, enum umb_log_level level, const char *message);

#ifdef __cplusplus
}
#endif
#endif
