/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage query: batches of points go through a ring of slots, and answers are written in order.
 *
 * Each slot reads a batch, starts the query, waits for it and writes the answers. With a daemon
 * several slots are under way at once; a file answers at once. Memory is bounded by slots times the
 * batch, whatever the input. The client's thread writes to a slot until that thread sets `done`
 * under the lock. Closing the client waits for the thread, so slots may be freed afterwards.
 */
#include "cli_query_options.h"

#include <inttypes.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include "cli_answers.h"
#include "cli_partial.h"
#include "tool/progress.h"
#include "tool/clock.h"
#include "tool/tool_try.h"

#define SLOTS 4 /* batches under way: reading and the round trip overlap */

struct job;

struct slot {
    struct job *job;
    struct umbc_batch batch;
    struct umb_points points; /* points of the batch */
    float *answers;           /* [columns * batch_size], room for the widest answers */
    void **values;            /* [columns] answers for each light */
    bool done;                /* true: answered; under the job's lock */
    struct umb_error error;
    struct umb_query_stats *stats; /* [light_count] */
    uint8_t asset_id[UMB_ID_BYTES];
    uint64_t server_ns;
    struct umb_client_query_reply stated; /* a daemon's reply: level, taps, bound */
};

/* Numbers of a point and light from a partial file: the answer and its two bounds. */
#define BOUNDED 3

struct job {
    const struct umbc_query_options *options;
    const struct umb_asset *asset; /* the file's asset; NULL: a daemon's */
    struct umb_asset *whole;       /* the same, if the file is whole */
    struct umb_partial *partial;   /* the partial file; NULL: none */
    size_t columns;                /* numbers of a point: its lights, or BOUNDED times as many */
    struct umb_query_settings *by_light; /* [light_count] settings of a partial file's lights */
    bool bad_file;                       /* true: the file could not be opened */
    struct umb_query *queries;           /* [light_count] prepared queries of the file */
    uint32_t *lights;                    /* [light_count] */
    size_t light_count;
    size_t batch_size;         /* number of points in a call */
    struct umb_client *client; /* connection to the daemon; NULL: a file */
    struct umb_query_settings settings;
    struct umb_dial dial;
    struct umbc_points source;
    FILE *footprints; /* footprints of the points, or NULL */
    struct umbc_answers answers;
    struct umbu_progress progress;
    struct umbc_query_total total;
    struct slot slots[SLOTS];
    size_t slot_count; /* number of slots in use; a file needs one */
    pthread_mutex_t lock;
    pthread_cond_t changed;
};

/* Answers the points of a slot from a partial file, with bounds. */
static enum umb_status answer_partly(struct job *job, struct slot *slot, struct umb_error *error)
{
    for (size_t k = 0; k < job->light_count; k++) {
        struct umb_partial_answers answers = {.values = slot->values[BOUNDED * k],
                                              .low = slot->values[BOUNDED * k + 1],
                                              .high = slot->values[BOUNDED * k + 2],
                                              .stats = slot->stats[k]};
        UMB__TRY(
            umb_partial_query(job->partial, &job->by_light[k], &slot->points, 0, &answers, error));
        slot->stats[k] = answers.stats;
        job->total.exact += answers.exact;
        if (answers.worst_error_m > job->total.worst_error_m) {
            job->total.worst_error_m = answers.worst_error_m;
        }
    }
    return UMB_OK;
}

/* Answers a slot from the file. */
static void answer_here(struct job *job, struct slot *slot)
{
    struct umb_light_answers answers = {.values = slot->values, .stats = slot->stats};
    slot->error.status = umb_points_check(&slot->points, &slot->error);
    if (slot->error.status == UMB_OK) {
        const double start = umbu_thread_cpu_s();
        if (job->partial != NULL) {
            slot->error.status = answer_partly(job, slot, &slot->error);
        } else {
            umb_query_run_lights(job->queries, job->light_count, &slot->points, 0,
                                 slot->points.count, &answers);
        }
        job->total.here_s += umbu_thread_cpu_s() - start;
    } else {
        slot->error.status = UMB_E_FORMAT; /* the input's fault, not the command line's */
    }
    slot->done = true;
}

/* Stores the answer of a slot. Runs on the client's thread. */
static void on_answered(void *user, enum umb_status status,
                        const struct umb_client_query_reply *reply, const struct umb_error *error)
{
    struct slot *slot = user;
    if (status == UMB_OK) {
        memcpy(slot->values[0], reply->values, reply->value_bytes);
        memcpy(slot->asset_id, reply->asset_id, sizeof slot->asset_id);
        slot->stats[0] = reply->stats;
        slot->server_ns = reply->nanoseconds;
        slot->stated = *reply;
        slot->stated.values = NULL; /* borrowed, gone after this */
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
    memset(slot->stats, 0, job->light_count * sizeof *slot->stats);
    slot->points = umbc_batch_view(&slot->batch, job->options->format, job->options->origin);
    if (job->client == NULL) {
        answer_here(job, slot);
        return UMB_OK;
    }
    struct umb_client_query_request request = {
        .asset = job->options->target,
        .settings = job->settings,
        .dial = job->dial,
        .points = slot->points,
        .want_stats = 1,
    };
    return umb_client_query_start(job->client, &request, on_answered, slot, NULL, error);
}

static void explain_slot(struct job *job, struct slot *slot)
{
    const float *values = slot->values[0];
    for (size_t i = 0; i < slot->batch.count; i++) {
        struct umb_explanation explanation;
        memset(&explanation, 0, sizeof explanation);
        umb_query_explain(&job->queries[0], &slot->points, i, &explanation);
        umbc_answers_explain(&job->answers, slot->batch.first + i, values[i], &explanation);
    }
}

static double fraction_read(const struct umbc_points *source)
{
    return source->size > 0 ? (double)source->offset / (double)source->size : -1;
}

/* Stores the daemon's figures of the setting that answered. */
static void take_stated(struct job *job, const struct umb_client_query_reply *stated)
{
    struct umbc_query_total *total = &job->total;
    if (stated->taps > 0) {
        total->taps = stated->taps;
        total->level = stated->level;
        total->bound_m = stated->bound_m;
        total->row.visibility_error = stated->visibility_error;
        total->row.lines = stated->lines;
    }
}

/* Waits for a slot and writes its answers. */
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
            /* Asking again helps: the exit code is 75. */
            return umb_fail(error, UMB_E_CANCELLED,
                            "asset '%.200s' was replaced during the query; ask again",
                            job->options->target);
        }
        memcpy(job->total.asset_id, slot->asset_id, UMB_ID_BYTES);
        take_stated(job, &slot->stated);
    }
    for (size_t k = 0; k < job->light_count; k++) {
        umb_query_stats_add(&job->total.stats, &slot->stats[k]);
    }
    job->total.server_ns += slot->server_ns;
    job->total.points += slot->batch.count;
    if (job->options->explain) {
        explain_slot(job, slot);
    } else if (!umbc_answers_put(&job->answers, (const void *const *)slot->values, job->columns,
                                 slot->batch.count)) {
        return umb_fail(error, UMB_E_IO, "cannot write '%.200s'", job->options->out);
    }
    umbu_progress_show(&job->progress, (double)job->total.points, fraction_read(&job->source));
    return UMB_OK;
}

/* Reads the next points and their footprints. Out: count: 0 at the end of both inputs. */
static enum umb_status read_slot(struct job *job, struct slot *slot, struct umb_error *error)
{
    const char *name = job->options->footprints;
    UMB__TRY(umbc_points_read(&job->source, &slot->batch, error));
    if (job->footprints == NULL) {
        return UMB_OK;
    }
    return slot->batch.count > 0
               ? umbc_footprints_read(job->footprints, name, &slot->batch, error)
               : umbc_footprints_end(job->footprints, name, job->source.count, error);
}

/* Runs the ring of slots. The slots from `oldest` up to but without `next` are under way. */
static enum umb_status run_ring(struct job *job, struct umb_error *error)
{
    uint64_t oldest = 0, next = 0;
    bool input_over = false;
    for (;;) { /* ends with the input */
        while (!input_over && next - oldest < job->slot_count) {
            struct slot *slot = &job->slots[next % job->slot_count];
            UMB__TRY(read_slot(job, slot, error));
            input_over = slot->batch.count == 0;
            if (!input_over) {
                UMB__TRY(start_slot(job, slot, error));
                next++;
            }
        }
        if (oldest == next) {
            return UMB_OK;
        }
        UMB__TRY(finish_slot(job, &job->slots[oldest % job->slot_count], error));
        oldest++;
    }
}

/* Sends an empty call if there were no points. The daemon then refuses a wrong asset or light, as a
 * file does, and returns the asset's id. */
static enum umb_status ask_nothing(struct job *job, struct umb_error *error)
{
    struct umb_client_query_reply reply;
    struct umb_client_query_request request = {
        .asset = job->options->target,
        .settings = job->settings,
        .dial = job->dial,
    };
    UMB__TRY(umb_client_query(job->client, &request, NULL, &reply, error));
    memcpy(job->total.asset_id, reply.asset_id, UMB_ID_BYTES);
    return UMB_OK;
}

/* --- the settings that follow from --max-error or --budget --- */

static enum umb_status calibrate(const struct umb_asset *asset, uint32_t light,
                                 const struct umbc_query_options *options,
                                 struct umb_calibration *calibration, struct umb_error *error)
{
    struct umbc_batch sample = {0};
    enum umb_status status =
        umbc_points_sample(options->points, options->format, options->with_normals,
                           UMBC_SAMPLE_POINTS, &sample, error);
    if (status == UMB_OK) {
        const struct umb_points points = umbc_batch_view(&sample, options->format, options->origin);
        status =
            points.count > 0 && umb_points_check(&points, NULL) == UMB_OK
                ? umb_calibrate_points(asset, light, &points, umbu_thread_cpu_s, calibration, error)
                : umb_calibrate(asset, light, umbu_thread_cpu_s, calibration, error);
    }
    umbc_batch_finish(&sample);
    return status;
}

/* Chooses the settings for a light of a local file. For a budget it measures the costs on a sample
 * of the points to query, or on points all over the scene if the input cannot be read twice. Out:
 * calibration: empty without a budget. */
static enum umb_status dial_settings(const struct umb_asset *asset, uint32_t light,
                                     const struct umbc_query_options *options,
                                     struct umb_query_settings *settings,
                                     struct umb_calibration *calibration, struct umb_error *error)
{
    memset(calibration, 0, sizeof *calibration);
    *settings = options->settings;
    settings->light = light;
    if (options->dial.budget_ns > 0) {
        UMB__TRY(calibrate(asset, light, options, calibration, error));
    }
    return options->has_dial
               ? umb_dial_choose(asset, &options->dial, calibration, settings, NULL, error)
               : UMB_OK;
}

/* Lets a daemon choose level and taps for a budget, by a sample of the points to query, sent in one
 * call. All points are then answered with the same settings. */
static enum umb_status dial_ask(struct umb_client *client, const struct umbc_query_options *options,
                                size_t batch, struct umb_query_settings *settings,
                                double *expected_ns, struct umb_error *error)
{
    struct umbc_batch sample = {0};
    struct umb_client_query_reply reply;
    enum umb_status status = umbc_points_sample(options->points, options->format,
                                                options->with_normals, batch, &sample, error);
    float *values = calloc(sample.count + 1, sizeof *values);
    if (status == UMB_OK && values == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu answers", sample.count);
    }
    if (status == UMB_OK) {
        const struct umb_client_query_request request = {
            .asset = options->target,
            .settings = options->settings,
            .dial = options->dial,
            .points = umbc_batch_view(&sample, options->format, options->origin),
            .want_stats = 1,
        };
        status = umb_client_query(client, &request, values, &reply, error);
    }
    if (status == UMB_OK && reply.expected_ns <= 0) {
        status = umb_fail(error, UMB_E_UNSUPPORTED, "budget: the server does not know budgets");
    }
    if (status == UMB_OK) {
        settings->taps = reply.taps;
        settings->level = reply.level;
        *expected_ns = reply.expected_ns;
    }
    free(values);
    umbc_batch_finish(&sample);
    return status;
}

/* Stores the error bound, the curve's row and the expected time of the settings in the totals. */
static void dial_state(const struct umb_asset *asset, const struct umb_query_settings *settings,
                       const struct umb_calibration *calibration, struct umbc_query_total *total)
{
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
    size_t count;
    (void)umb_asset_get_curve(asset, settings->light, rows, &count);
    total->level = settings->level;
    total->bound_m = umb_query_bound_m(asset, settings);
    for (size_t i = 0; i < count; i++) {
        if (rows[i].level == settings->level && rows[i].taps == total->taps &&
            umb_filter_get_info(settings->filter)->has_curve) {
            total->row = rows[i];
            total->expected_ns = i < calibration->count ? calibration->ns[i] : 0;
        }
    }
}

/* --- the asset --- */

/* Lists the lights to query: those of the options, or all of the asset. */
static enum umb_status choose_lights(struct job *job, struct umb_error *error)
{
    const struct umbc_query_options *options = job->options;
    struct umb_asset_info info = {.light_count = 0};
    if (job->asset != NULL) {
        umb_asset_get_info(job->asset, &info);
    }
    job->light_count = options->all_lights ? info.light_count : options->light_count;
    job->lights = calloc(job->light_count + 1, sizeof *job->lights);
    job->queries = calloc(job->light_count + 1, sizeof *job->queries);
    if (job->lights == NULL || job->queries == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu lights", job->light_count);
    }
    for (size_t k = 0; k < job->light_count; k++) {
        job->lights[k] = options->all_lights ? (uint32_t)k : options->lights[k];
    }
    job->columns = job->partial != NULL ? BOUNDED * job->light_count : job->light_count;
    job->by_light = calloc(job->light_count + 1, sizeof *job->by_light);
    if (job->by_light == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu lights", job->light_count);
    }
    job->total.lights = job->lights;
    job->total.taps = options->settings.taps;
    job->total.light_count = job->light_count;
    return UMB_OK;
}

static enum umb_status prepare_lights(struct job *job, struct umb_error *error)
{
    for (size_t k = 0; k < job->light_count; k++) {
        struct umb_query_settings settings = job->options->settings;
        struct umb_calibration calibration;
        UMB__TRY(dial_settings(job->asset, job->lights[k], job->options, &settings, &calibration,
                               error));
        UMB__TRY(umb_query_prepare(job->asset, &settings, &job->queries[k], error));
        job->by_light[k] = settings;
        if (k == 0) {
            job->total.taps = umb_query_taps(&job->queries[0]);
            dial_state(job->asset, &settings, &calibration, &job->total);
        }
    }
    return UMB_OK;
}

/* Connects, asks for the number of points in a call, and turns a budget into settings. */
static enum umb_status open_asset(struct job *job, struct umb_error *error)
{
    const struct umbc_query_options *options = job->options;
    job->settings = options->settings;
    job->dial = options->dial;
    struct umb_client_limits limits;
    UMB__TRY(umbu_connect(&options->session, &job->client, error));
    UMB__TRY(umb_client_get_limits(job->client, &limits, error));
    UMB__TRY(umbc_call_size(options, &limits, &job->batch_size, error));
    if (job->dial.budget_ns > 0) {
        UMB__TRY(dial_ask(job->client, options, job->batch_size, &job->settings,
                          &job->total.expected_ns, error));
        memset(&job->dial, 0, sizeof job->dial);
    }
    return UMB_OK;
}

/* Opens the file: a whole one, or a partial one with the pages that it has. */
static enum umb_status open_file(struct job *job, struct umb_error *error)
{
    struct umb_partial_stats stats;
    if (!umbc_is_partial(job->options->target)) {
        const enum umb_status status =
            umb_asset_open_file(job->options->target, NULL, &job->whole, error);
        job->asset = job->whole;
        return status;
    }
    UMB__TRY(umbc_partial_open(job->options->target, &job->partial, error));
    umb_partial_get_stats(job->partial, &stats);
    job->asset = umb_partial_lower(job->partial);
    job->total.is_partial = true;
    job->total.pages_held = stats.pages_held;
    job->total.page_count = stats.page_count;
    return UMB_OK;
}

static enum umb_status open_target(struct job *job, struct umb_error *error)
{
    const struct umbc_query_options *options = job->options;
    job->batch_size = options->batch;
    if (!umbc_is_file(options->target)) {
        UMB__TRY(choose_lights(job, error));
        return open_asset(job, error);
    }
    struct umb_asset_info info;
    enum umb_status status = open_file(job, error);
    if (status != UMB_OK) {
        job->bad_file = true;
        return status;
    }
    if (job->partial != NULL && (options->explain || options->encoding == UMBC_ENCODING_U8 ||
                                 options->encoding == UMBC_ENCODING_BIT)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "a partial file answers numbers with bounds: no --explain, and text or f32 "
                        "as --encoding");
    }
    umb_asset_get_info(job->asset, &info);
    memcpy(job->total.asset_id, info.id, UMB_ID_BYTES);
    UMB__TRY(choose_lights(job, error));
    return prepare_lights(job, error);
}

static enum umb_status open_slot(struct job *job, struct slot *slot, struct umb_error *error)
{
    const size_t batch = job->batch_size;
    UMB__TRY(umbc_batch_init(&slot->batch, batch, job->options->format, error));
    slot->job = job;
    slot->stats = calloc(job->light_count + 1, sizeof *slot->stats);
    slot->values = calloc(job->columns + 1, sizeof *slot->values);
    slot->answers = calloc(job->columns * batch + 1, sizeof *slot->answers);
    if (slot->stats == NULL || slot->values == NULL || slot->answers == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu answers of %zu lights",
                        batch, job->light_count);
    }
    for (size_t k = 0; k < job->columns; k++) {
        slot->values[k] = slot->answers + k * batch;
    }
    return UMB_OK;
}

static enum umb_status open_slots(struct job *job, struct umb_error *error)
{
    job->slot_count = job->client != NULL ? SLOTS : 1;
    for (size_t i = 0; i < job->slot_count; i++) {
        UMB__TRY(open_slot(job, &job->slots[i], error));
    }
    return UMB_OK;
}

static enum umb_status run_job(struct job *job, struct umb_error *error)
{
    const struct umbc_query_options *options = job->options;
    UMB__TRY(open_target(job, error));
    UMB__TRY(umbc_points_open(options->points, options->format, options->with_normals, &job->source,
                              error));
    if (options->footprints != NULL) {
        UMB__TRY(umbc_open_input(options->footprints, &job->footprints, error));
    }
    UMB__TRY(open_slots(job, error));
    UMB__TRY(umbc_answers_begin(options, &job->answers, error));
    umbu_progress_begin(&job->progress, "points", options->quiet);
    enum umb_status status = run_ring(job, error);
    if (status == UMB_OK && job->total.points == 0 && job->client != NULL) {
        status = ask_nothing(job, error);
    }
    job->total.seconds = umbu_clock_s() - job->progress.started_s;
    umbu_progress_end(&job->progress);
    return status == UMB_OK ? umbc_answers_end(&job->answers, &job->total, error) : status;
}

static void close_job(struct job *job)
{
    umb_client_close(job->client); /* first: its thread may still write into slots */
    umbc_answers_abandon(&job->answers);
    umbc_points_close(&job->source);
    if (job->footprints != NULL) {
        (void)fclose(job->footprints);
    }
    for (size_t i = 0; i < SLOTS; i++) {
        umbc_batch_finish(&job->slots[i].batch);
        free(job->slots[i].answers);
        free(job->slots[i].values);
        free(job->slots[i].stats);
    }
    free(job->queries);
    free(job->lights);
    free(job->by_light);
    umb_asset_close(job->whole);
    umb_partial_close(job->partial);
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
    if (total->points > 0 && total->stats.outside == total->points * total->light_count) {
        (void)fprintf(stderr,
                      "warning: all points lie outside the asset's bounds (`umbrage info`): "
                      "are their units and --origin right?\n");
    }
    if (total->stats.undefined > 0) {
        (void)fprintf(stderr,
                      "%" PRIu64 " points undefined: too far from any surface of an asset baked "
                      "under the static rule\n",
                      total->stats.undefined);
    }
    if (total->is_partial) {
        const uint64_t answers = total->points * total->light_count;
        (void)fprintf(stderr,
                      "%" PRIu32 " of %" PRIu32 " pages: %" PRIu64 " of %" PRIu64
                      " answers exact, boundaries of the others within %.4g m\n",
                      total->pages_held, total->page_count, total->exact, answers,
                      total->worst_error_m);
    }
    if (total->bound_m > 0) {
        (void)fprintf(stderr, "level %" PRIu32 ", %" PRIu32 " taps: true boundaries within %.4g m",
                      total->level, total->taps, total->bound_m);
        if (total->row.lines > 0) {
            (void)fprintf(stderr, ", visibility error %.3g, %.3g cache lines a point",
                          total->row.visibility_error, total->row.lines);
        }
        if (total->expected_ns > 0) {
            (void)fprintf(stderr, ", %.3g ns a point expected", total->expected_ns);
        }
        if (umbc_query_ns(total) > 0) {
            (void)fprintf(stderr, ", %.3g ns taken", umbc_query_ns(total));
        }
        (void)fputc('\n', stderr);
    }
}

int umbc_query(int argc, char **argv)
{
    struct umbc_query_options options;
    struct umb_error error = {.status = UMB_OK};
    int code = umbc_query_options_parse(argc, argv, &options);
    if (code >= 0) {
        return code;
    }
    if (options.volume_query != UMBC_ASK_POINTS) {
        return umbc_query_volume(&options);
    }
    struct job *job = malloc(sizeof *job);
    if (job == NULL) {
        return umbc_complain_as(UMB_E_NO_MEMORY, "query: out of memory");
    }
    *job = (struct job){.options = &options,
                        .lock = PTHREAD_MUTEX_INITIALIZER,
                        .changed = PTHREAD_COND_INITIALIZER};
    enum umb_status status = run_job(job, &error);
    struct umbc_query_total total = job->total;
    bool bad_file = job->bad_file;
    close_job(job);
    if (status != UMB_OK) {
        error.status = status;
        return bad_file ? umbc_complain_file(options.target, &error) : umbc_complain_query(&error);
    }
    if (!options.quiet) {
        print_summary(&total);
    }
    return umbc_finish_stdout(0);
}
