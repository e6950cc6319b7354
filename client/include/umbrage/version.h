/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_VERSION_H
#define UMBRAGE_VERSION_H
/*
 * The version of the libraries, and what stays the same from one version to the next.
 *
 *     if (umb_version() < UMB_VERSION) {
 *         fprintf(stderr, "libumbrage-core is older than the headers\n");
 *     }
 *
 * A program that was compiled against one version runs with every later version of the same MAJOR,
 * without a new build. MINOR adds, PATCH repairs. What breaks a program takes a new MAJOR and a new
 * number behind the libraries' names (libumbrage-core.so.1). Headers marked experimental may take
 * that new number with a new MINOR.
 *
 * Functions stay, with their parameters and their meaning.
 * Enums are ints. A value keeps its number; later versions add values. Treat a value that you do
 * not know as "something newer".
 * Structs keep their size, and their members keep their places and types. A struct that ends in
 * `reserved` may grow: a later version takes words of `reserved`, from the first on, for new
 * members, and 0 in them means what the earlier version did. A struct without `reserved` is closed.
 * So start every struct that you fill in with zeros (`= {0}` in C, `= {}` in C++). A word of
 * `reserved` that is not 0 is refused with E_ARGUMENT by the function that checks the struct: it is
 * a setting that this version does not know.
 * Handles (struct umb_asset and others without members) and storage (`opaque`) are the libraries'
 * own.
 *
 * These rules hold on 64-bit systems. The tests compare every struct, enum and function with a
 * record (tests/abi).
 *
 * Threads: pure functions.
 * Stability: stable.
 */
#include <stdint.h>
#include "umbrage/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define UMB_VERSION_MAJOR 0
#define UMB_VERSION_MINOR 1
#define UMB_VERSION_PATCH 0

/* The version of these headers as one number, for comparing: 1.2.3 is 10203. */
#define UMB_VERSION (UMB_VERSION_MAJOR * 10000 + UMB_VERSION_MINOR * 100 + UMB_VERSION_PATCH)

/* The same as text: "1.2.3". */
#define UMB_VERSION_TEXT                                                                           \
    UMB_TEXT_OF(UMB_VERSION_MAJOR)                                                                 \
    "." UMB_TEXT_OF(UMB_VERSION_MINOR) "." UMB_TEXT_OF(UMB_VERSION_PATCH)
#define UMB_TEXT_OF(number)    UMB_TEXT_OF_IT(number)
#define UMB_TEXT_OF_IT(number) #number

/* Returns the version of the loaded library, in the form of UMB_VERSION. */
UMB_API uint32_t umb_version(void);

#ifdef __cplusplus
}
#endif
#endif
