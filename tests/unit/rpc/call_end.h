/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_CALL_END_H
#define UMBRAGE_TESTS_CALL_END_H
/* The end of an asynchronous call, waited for by a test. */
#include <pthread.h>
#include <string.h>
#include "umbrage/client.h"

struct end {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    unsigned calls;
    enum umb_status status;
    struct umb_error error;
};

static void end_init(struct end *end)
{
    memset(end, 0, sizeof *end);
    assert_int_equal(pthread_mutex_init(&end->lock, NULL), 0);
    assert_int_equal(pthread_cond_init(&end->changed, NULL), 0);
}

static void on_end(void *user, enum umb_status status, const struct umb_error *error)
{
    struct end *end = user;
    pthread_mutex_lock(&end->lock);
    end->calls++;
    end->status = status;
    if (error != NULL) {
        end->error = *error;
    }
    pthread_cond_signal(&end->changed);
    pthread_mutex_unlock(&end->lock);
}

static void end_wait(struct end *end)
{
    pthread_mutex_lock(&end->lock);
    while (end->calls == 0) {
        pthread_cond_wait(&end->changed, &end->lock);
    }
    pthread_mutex_unlock(&end->lock);
}

#endif
