/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The guard: one jump buffer for each thread, which the handler finds through a thread-local
 * pointer.
 *
 * Leaving the handler by a jump is safe here. Both signals are raised by the instruction that reads
 * (POSIX: generated synchronously). So the interrupted code is the guarded function and never a
 * half-done allocation or a held lock. The handler restores the signal mask from the interrupted
 * context, so the jump buffer saves none: saving it would cost a system call for each batch.
 * Source: POSIX.1-2008, sigsetjmp and sigaction, "Rationale".
 */
#include "store/fault_guard.h"

#include <pthread.h>
#include <setjmp.h>
#include <signal.h>
#include <stdint.h>
#include <ucontext.h>

struct guard {
    sigjmp_buf back;
    uintptr_t begin;
    size_t bytes;
};

/* Volatile: the handler of the same thread reads it. */
static _Thread_local struct guard *volatile current;

static struct sigaction before_bus, before_segv;
static pthread_mutex_t installing = PTHREAD_MUTEX_INITIALIZER;

/* Restores the signal's earlier handler for a fault outside the guarded range. The instruction then
 * runs again and faults again; a signal that a process sent is raised again. */
static void pass_on(int number, const siginfo_t *info)
{
    sigaction(number, number == SIGBUS ? &before_bus : &before_segv, NULL);
    if (info->si_code <= 0) {
        raise(number);
    }
}

static void on_fault(int number, siginfo_t *info, void *context)
{
    struct guard *guard = current;
    if (guard != NULL && info->si_code > 0 &&
        (uintptr_t)info->si_addr - guard->begin < guard->bytes) {
        const ucontext_t *interrupted = context;
        pthread_sigmask(SIG_SETMASK, &interrupted->uc_sigmask, NULL);
        current = NULL;
        siglongjmp(guard->back, 1);
    }
    pass_on(number, info);
}

static void take_over(int number, struct sigaction *before)
{
    struct sigaction now;
    struct sigaction ours = {.sa_sigaction = on_fault, .sa_flags = SA_SIGINFO};
    sigemptyset(&ours.sa_mask);
    sigaction(number, NULL, &now);
    if (!(now.sa_flags & SA_SIGINFO) || now.sa_sigaction != on_fault) {
        *before = now;
        sigaction(number, &ours, NULL);
    }
}

void umbs_fault_guard_install(void)
{
    pthread_mutex_lock(&installing);
    take_over(SIGBUS, &before_bus);
    take_over(SIGSEGV, &before_segv);
    pthread_mutex_unlock(&installing);
}

int umbs_fault_guarded(const void *begin, size_t bytes, void (*read)(void *user), void *user)
{
    struct guard guard = {.begin = (uintptr_t)begin, .bytes = bytes};
    if (sigsetjmp(guard.back, 0) != 0) {
        return 0;
    }
    current = &guard;
    read(user);
    current = NULL;
    return 1;
}
