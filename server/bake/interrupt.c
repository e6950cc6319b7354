/* SPDX-License-Identifier: Apache-2.0 */
/* SA_RESETHAND gives a second signal its default meaning. */
#include "bake/interrupt.h"

#include <signal.h>
#include <stdatomic.h>
#include <string.h>

static atomic_int caught; /* lock-free: allowed in a handler */

static void handle(int number)
{
    (void)number;
    atomic_store(&caught, 1);
}

void umbb_interrupt_install(void)
{
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = handle;
    action.sa_flags = (int)SA_RESETHAND;
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}

int umbb_interrupted(void)
{
    return atomic_load_explicit(&caught, memory_order_relaxed);
}
