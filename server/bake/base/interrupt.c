/* SPDX-License-Identifier: Apache-2.0 */
/*
 * One handler for all signals. They come in bursts (a terminal and a supervisor both send one,
 * timeout(1) sends two), so a further signal counts as a second request only after a while.
 */
#include "bake/base/interrupt.h"

#include <signal.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

#include "tool/clock.h"
#include "umbrage/status.h"
#include "tool/exit_code.h"

#define BURST_S 1

/* Lock-free: allowed in a handler. */
static atomic_int caught;
static atomic_long caught_at_s; /* 0 = not yet */
static atomic_int deferred;
static atomic_int exit_code;

static void handle(int number)
{
    static const char farewell[] = "umbrage-bake: interrupted: nothing was written\n";
    if (!atomic_load(&deferred)) {
        (void)!write(STDERR_FILENO, farewell, sizeof farewell - 1);
        _exit(atomic_load(&exit_code));
    }
    const long now_s = (long)umbu_clock_s() + 1;
    long first_s = 0;
    if (atomic_compare_exchange_strong(&caught_at_s, &first_s, now_s)) {
        atomic_store(&caught, 1);
    } else if (number != SIGXCPU && now_s - first_s > BURST_S) { /* SIGXCPU comes every second */
        (void)signal(number, SIG_DFL);
        (void)raise(number);
    }
}

void umbb_interrupt_install(void)
{
    static const int caught_signals[] = {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGXCPU};
    struct sigaction action, before;
    atomic_store(&exit_code, umbu_exit_code(UMB_E_CANCELLED));
    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    action.sa_handler = SIG_IGN;
    sigaction(SIGPIPE, &action, NULL);
    sigaction(SIGXFSZ, &action, NULL);
    action.sa_handler = handle;
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
