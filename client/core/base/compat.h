/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CORE_BASE_COMPAT_H
#define UMBRAGE_CORE_BASE_COMPAT_H
/* Differences between compilers: how they report sanitizers, and attributes that some lack. */

#ifndef __has_attribute
#define __has_attribute(name) 0
#endif

/* UMB__TSAN is 1 in a build under ThreadSanitizer, UMB__SANITIZED in a build under any sanitizer
 * that keeps shadow memory. Such a program needs terabytes of address space, so it cannot run under
 * a limit of address space. gcc reports sanitizers by macros, clang by features. */
#ifdef __has_feature
#define UMB__FEATURE(name) __has_feature(name)
#else
#define UMB__FEATURE(name) 0
#endif
#if defined(__SANITIZE_THREAD__) || UMB__FEATURE(thread_sanitizer)
#define UMB__TSAN 1
#else
#define UMB__TSAN 0
#endif
#if UMB__TSAN || defined(__SANITIZE_ADDRESS__) || UMB__FEATURE(address_sanitizer) ||               \
    UMB__FEATURE(memory_sanitizer)
#define UMB__SANITIZED 1
#else
#define UMB__SANITIZED 0
#endif

/*
 * Attribute of a large local variable in a function that runs once a request and writes every byte
 * it reads. Release builds zero all other locals (-ftrivial-auto-var-init), which for arrays of 2
 * KiB costs a small query 10 % of the server's time.
 */
#if __has_attribute(uninitialized)
#define UMB__UNSET __attribute__((uninitialized))
#else
#define UMB__UNSET
#endif

#endif
