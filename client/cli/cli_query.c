/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage query: batches of points through a ring of slots, answers in order.
 *
 * A slot is read, started, waited for and written. With a daemon several are under way at once;
 * a file answers at the start. Memory is bounded by slots times the batch, whatever the input.
 * Slots are written by the client's thread until their `done` is set under the lock; closing the
 * client waits for that thread, so that slots may be freed after it.
 */
#include "cli_query_options.h"

#include <inttypes.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include "cli_answers.h"
#include "cli_progress.h"

#define SLOTS 4 /* batches under way; hides the round trip and reading the next points */

struct job;

struct slot {
    struct job *job;
    struct umbc_batch batch;
    struct umb_points points; /* view of batch */
    void *values;
    bool done; /* under the job's lock */
    struct umb_error error;
    struct umb_query_stats stats;
    uint8_t asset_id[UMB_ID_BYTES];
    uint64_t server_ns;
};

struct job {
    const struct umbc_query_options *options;
    struct umb_asset *asset; /* a file ... */
    bool bad_file;           /* ... that could not be opened */
    struct umb_query query;
    struct umb_client *client; /* ... or a daemon */
    struct umbc_points source;
    struct umbc_answers answers;
    struct umbc_progress progress;
    struct umbc_query_total total;
    struct slot slots[SLOTS];
    size_t slot_count; /* in use: a file needs one */
    pthread_mutex_t lock;
    pthread_cond_t changed;
};

static void add_stats(struct umb_query_stats *sum, const struct umb_query_stats *part)
{
    sum->points += part->points;
    sum->outside += part->outside;
    sum->before += part->before;
    sum->behind += part->behind;
    sum->facing_away += part->facing_away;
    sum->nodes += part->nodes;
    sum->bricks += part->bricks;
}

/* Answers a slot from the file, here and now. */
static void answer_here(struct job *job, struct slot *slot)
{
    struct umb_answers answers = {.values = slot->values};
    slot->error.status = umb_points_check(&slot->points, &slot->error);
    if (slot->error.status == UMB_OK) {
        umb_query_run(&job->query, &slot->points, 0, slot->points.count, &answers);
        slot->stats = answers.stats;
    } else {
        slot->error.status = UMB_E_FORMAT; /* the input's fault, not the command line's */
    }
    slot->done = true;
}

/* Runs on the client's thread. */
static void on_answered(void *user, enum umb_status status,
                        const struct umb_client_query_reply *reply, const struct umb_error *error)
{
    struct slot *slot = user;
    if (status == UMB_OK) {
        memcpy(slot->values, reply->values, reply->value_bytes);
        memcpy(slot->asset_id, reply->asset_id, sizeof slot->asset_id);
        slot->stats = reply->stats;
        slot->server_ns = reply->nanoseconds;
    } else {
        slot->error = *error;
    }
    pthread_mutex_lock(&slot->job->lock);
    slot->error.status = status;
    slot->done = true;
    pthread_cond_signal(&slot->job->changed);
    pthread_mutex_unlock(&slot->job->lock);
}

static enum umb_status start_slot(struct job *job, struct slot *slot, struct umb_error *error)
{
    slot->done = false;
    memset(&slot->error, 0, sizeof slot->error);
    memset(&slot->stats, 0, sizeof slot->stats);
    slot->points = umbc_batch_view(&slot->batch, job->options->format, job->options->origin);
    if (job->client == NULL) {
        answer_here(job, slot);
        return UMB_OK;
    }
    struct umb_client_query_request request = {
        .asset = job->options->target,
        .settings = job->options->settings,
        .points = slot->points,
        .want_stats = 1,
    };
    return umb_client_query_start(job->client, &request, on_answered, slot, error);
}

static void explain_slot(struct job *job, struct slot *slot)
{
    const float *values = slot->values;
    for (size_t i = 0; i < slot->batch.count; i++) {
        struct umb_explanation explanation;
        memset(&explanation, 0, sizeof explanation);
        umb_query_explain(&job->query, &slot->points, i, &explanation);
        umbc_answers_explain(&job->answers, slot->batch.first + i, values[i], &explanation);
    }
}

static double fraction_read(const struct umbc_points *source)
{
    return source->size > 0 ? (double)source->offset / (double)source->size : -1;
}

/* Waits for a slot and writes what it says. */
static enum umb_status finish_slot(struct job *job, struct slot *slot, struct umb_error *error)
{
    pthread_mutex_lock(&job->lock);
    while (!slot->done) {
        pthread_cond_wait(&job->changed, &job->lock);
    }
    pthread_mutex_unlock(&job->lock);
    if (slot->error.status != UMB_OK) {
        *error = slot->error;
        return slot->error.status;
    }
    if (job->client != NULL) {
        if (job->total.points > 0 &&
            memcmp(job->total.asset_id, slot->asset_id, UMB_ID_BYTES) != 0) {
            /* Asking again helps, so that the exit code must say 75. */
            return umb_fail(error, UMB_E_CANCELLED,
                            "asset '%.200s' was replaced during the query; ask again",
                            job->options->target);
        }
        memcpy(job->total.asset_id, slot->asset_id, UMB_ID_BYTES);
    }
    add_stats(&job->total.stats, &slot->stats);
    job->total.server_ns += slot->server_ns;
    job->total.points += slot->batch.count;
    if (job->options->explain) {
        explain_slot(job, slot);
    } else if (!umbc_answers_put(&job->answers, slot->values, slot->batch.count)) {
        return umb_fail(error, UMB_E_IO, "cannot write '%.200s'", job->options->out);
    }
    umbc_progress_show(&job->progress, job->total.points, fraction_read(&job->source));
    return UMB_OK;
}

/* The ring: slots [oldest, next) are under way. */
static enum umb_status run_ring(struct job *job, struct umb_error *error)
{
    uint64_t oldest = 0;
    uint64_t next = 0;
    bool input_over = false;
    enum umb_status status = UMB_OK;
    while (status == UMB_OK) {
        while (status == UMB_OK && !input_over && next - oldest < job->slot_count) {
            struct slot *slot = &job->slots[next % job->slot_count];
            status = umbc_points_read(&job->source, &slot->batch, error);
            if (status == UMB_OK && slot->batch.count == 0) {
                input_over = true;
            } else if (status == UMB_OK) {
                status = start_slot(job, slot, error);
                next++;
            }
        }
        if (status != UMB_OK || oldest == next) {
            break;
        }
        status = finish_slot(job, &job->slots[oldest % job->slot_count], error);
        oldest++;
    }
    return status;
}

/* Without points nothing was sent; an empty call still refuses a wrong asset or light, as a file
 * does, and tells the id. */
static enum umb_status ask_nothing(struct job *job, struct umb_error *error)
{
    struct umb_client_query_reply reply;
    struct umb_client_query_request request = {
        .asset = job->options->target,
        .settings = job->options->settings,
    };
    enum umb_status status = umb_client_query(job->client, &request, NULL, &reply, error);
    if (status == UMB_OK) {
        memcpy(job->total.asset_id, reply.asset_id, UMB_ID_BYTES);
    }
    return status;
}

static enum umb_status open_target(struct job *job, struct umb_error *error)
{
    const struct umbc_query_options *options = job->options;
    if (!umbc_is_file(options->target)) {
        return umbc_connect(options->address, &job->client, error);
    }
    struct umb_asset_info info;
    enum umb_status status = umb_asset_open_file(options->target, NULL, &job->asset, error);
    if (status != UMB_OK) {
        job->bad_file = true;
        return status;
    }
    umb_asset_get_info(job->asset, &info);
    memcpy(job->total.asset_id, info.id, UMB_ID_BYTES);
    return umb_query_prepare(job->asset, &options->settings, &job->query, error);
}

static enum umb_status open_slots(struct job *job, struct umb_error *error)
{
    job->slot_count = job->client != NULL ? SLOTS : 1;
    size_t batch = job->options->batch;
    for (size_t i = 0; i < job->slot_count; i++) {
        struct slot *slot = &job->slots[i];
        slot->job = job;
        enum umb_status status = umbc_batch_init(&slot->batch, batch, job->options->format, error);
        if (status != UMB_OK) {
            return status;
        }
        slot->values = calloc(batch, sizeof(float)); /* the widest answer */
        if (slot->values == NULL) {
            return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu answers", batch);
        }
    }
    return UMB_OK;
}

static enum umb_status run_job(struct job *job, struct umb_error *error)
{
    const struct umbc_query_options *options = job->options;
    enum umb_status status = open_target(job, error);
    if (status == UMB_OK) {
        status = umbc_points_open(options->points, options->format, options->with_normals,
                                  &job->source, error);
    }
    if (status == UMB_OK) {
        status = open_slots(job, error);
    }
    if (status == UMB_OK) {
        status = umbc_answers_begin(options, &job->answers, error);
    }
    if (status != UMB_OK) {
        return status;
    }
    umbc_progress_begin(&job->progress, options->quiet);
    status = run_ring(job, error);
    if (status == UMB_OK && job->total.points == 0 && job->client != NULL) {
        status = ask_nothing(job, error);
    }
    job->total.seconds = umbc_clock_s() - job->progress.started_s;
    umbc_progress_end(&job->progress);
    return status == UMB_OK ? umbc_answers_end(&job->answers, &job->total, error) : status;
}

static void close_job(struct job *job)
{
    umb_client_close(job->client); /* first: its thread may still write into slots */
    umbc_answers_abandon(&job->answers);
    umbc_points_close(&job->source);
    for (size_t i = 0; i < SLOTS; i++) {
        umbc_batch_finish(&job->slots[i].batch);
        free(job->slots[i].values);
    }
    umb_asset_close(job->asset);
    (void)pthread_cond_destroy(&job->changed);
    (void)pthread_mutex_destroy(&job->lock);
    free(job);
}

static void print_summary(const struct umbc_query_total *total)
{
    double seconds = total->seconds > 0 ? total->seconds : 1e-9;
    (void)fprintf(stderr,
                  "%" PRIu64 " points in %.3f s (%.3g points/s), %" PRIu64 " outside, %" PRIu64
                  " before, %" PRIu64 " behind, %" PRIu64 " facing away\n",
                  total->points, total->seconds, (double)total->points / seconds,
                  total->stats.outside, total->stats.before, total->stats.behind,
                  total->stats.facing_away);
}

int umbc_query(int argc, char **argv)
{
    struct umbc_query_options options;
    struct umb_error error = {.status = UMB_OK};
    int code = umbc_query_options_parse(argc, argv, &options);
    if (code >= 0) {
        return code;
    }
    struct job *job = calloc(1, sizeof *job);
    if (job == NULL || pthread_mutex_init(&job->lock, NULL) != 0) {
        free(job);
        return umbc_complain_as(UMB_E_NO_MEMORY, "query: out of memory");
    }
    if (pthread_cond_init(&job->changed, NULL) != 0) {
        (void)pthread_mutex_destroy(&job->lock);
        free(job);
        return umbc_complain_as(UMB_E_NO_MEMORY, "query: out of memory");
    }
    job->options = &options;
    enum umb_status status = run_job(job, &error);
    struct umbc_query_total total = job->total;
    bool bad_file = job->bad_file;
    close_job(job);
    if (status != UMB_OK) {
        error.status = status;
        return bad_file ? umbc_complain_file(options.target, &error) : umbc_complain(&error);
    }
    if (!options.quiet) {
        print_summary(&total);
    }
    return umbc_finish_stdout(0);
}
