/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_PARTS_H
#define UMBRAGE_SERVER_BAKE_SANDBOX_SANDBOX_PARTS_H
/* The layers behind sandbox.h. */

/* Each returns 1 if the calling process is now inside, else 0 and errno. */
int umbb_namespaces_enter(void);
int umbb_filter_enter(void);

/* Returns the ABI of the kernel's Landlock that now denies every path, or 0 and errno. */
int umbb_landlock_enter(void);

#endif
