/* SPDX-License-Identifier: Apache-2.0 */
/* The optional layer of namespaces. Sources: unshare(2), user_namespaces(7). */
#define _GNU_SOURCE /* unshare */
#include <sched.h>

#include "bake/sandbox/sandbox_parts.h"

int umbb_namespaces_enter(void)
{
    const int others = CLONE_NEWNET | CLONE_NEWIPC | CLONE_NEWUTS | CLONE_NEWNS;
    return unshare(CLONE_NEWUSER | others) == 0 || unshare(others) == 0;
}
