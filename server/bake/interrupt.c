/* SPDX-License-Identifier: Apache-2.0 */
/* SA_RESETHAND gives a second signal its default meaning. */
#include "bake/interrupt.h"

#include <signal.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

#include "umbrage/status.h"

/* Lock-free: allowed in a handler. */
static atomic_int caught;
static atomic_int deferred;
static atomic_int exit_code;

static void handle(int number)
{
    static const char farewell[] = "umbrage-bake: interrupted: nothing was written\n";
    (void)number;
    if (!atomic_load(&deferred)) {
        (void)!write(STDERR_FILENO, farewell, sizeof farewell - 1);
        _exit(atomic_load(&exit_code));
    }
    atomic_store(&caught, 1);
}

void umbb_interrupt_install(void)
{
    static const int caught_signals[] = {SIGINT, SIGTERM, SIGHUP};
    struct sigaction action, before;
    atomic_store(&exit_code, umb_status_exit(UMB_E_CANCELLED));
    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    action.sa_handler = SIG_IGN;
    sigaction(SIGPIPE, &action, NULL);
    sigaction(SIGXFSZ, &action, NULL);
    action.sa_handler = handle;
    action.sa_flags = (int)SA_RESETHAND;
    for (size_t i = 0; i < sizeof caught_signals / sizeof caught_signals[0]; i++) {
        if (sigaction(caught_signals[i], NULL, &before) == 0 && before.sa_handler != SIG_IGN) {
            sigaction(caught_signals[i], &action, NULL);
        }
    }
}

void umbb_interrupt_defer(void)
{
    atomic_store(&deferred, 1);
}

int umbb_interrupted(void)
{
    return atomic_load_explicit(&caught, memory_order_relaxed);
}
