/* SPDX-License-Identifier: Apache-2.0 */
/* The xxHash functions, which the library's header has the source of. */
#define XXH_STATIC_LINKING_ONLY
#define XXH_IMPLEMENTATION
#include <xxhash.h>
