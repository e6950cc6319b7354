/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Segments, columns and boxes from a file or a daemon; see cli_query_options.h. A file answers in
 * this process, a daemon in calls of the size that it takes.
 */
#include "cli_query_options.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "cli_record_progress.h"
#include "tool/clock.h"
#include "tool/json.h"
#include "tool/output.h"
#include "tool/tool_try.h"
#include "umbrage/volume.h"
#include "umbrage/volume_queries.h"

#define INTERVALS_KEPT 16 /* lit intervals that a batch keeps of each segment */

/* Records of one call, and the places of their answers. All records are of one kind. */
struct records {
    size_t count;
    struct umb_segments pairs;   /* segments, or corners of boxes */
    struct umb_points points;    /* points of columns */
    const struct umb_box *boxes; /* [count] */
    struct umb_segment_answers *segments;
    struct umb_column_answers *columns;
    struct umb_box_answers *shares;
};

/* Segments of the batch with more lit intervals than it keeps. They are queried again with room for
 * all their intervals, many in one call. */
struct long_segments {
    uint8_t *ends;
    struct umb_segment_answers answers;
    size_t count, next; /* number of them; number of the first that was not printed */
};

struct job {
    const struct umbc_query_options *options;
    const struct kind *kind;
    size_t batch_size;               /* records of a batch */
    struct umb_asset *file;          /* the file's asset; NULL: a daemon's */
    bool bad_file;                   /* true: the file could not be opened */
    struct umb_volume volume;        /* of the file */
    struct umb_frustum_info frustum; /* frustum of the light, for boxes of the file */
    double origin[3];                /* origin of the file's asset */
    struct umb_client *client;       /* connection to the daemon; NULL: a file */
    struct umb_client_limits limits; /* limits of the daemon */
    bool has_id;                     /* true: the daemon has answered once */
    uint8_t id[UMB_ID_BYTES];
    bool ignores_translucent;
    struct umbc_points source;
    struct umbc_record_progress progress;
    struct umbc_batch batch;
    struct umb_box *boxes; /* [batch_size] boxes of the batch */
    void *answers;         /* [batch_size] answers of the batch */
    struct umb_segment_answers segments;
    struct umb_column_answers columns;
    struct umb_box_answers shares;
    struct long_segments longs;
    struct umb_volume_stats stats;
    uint64_t count; /* number of records answered */
    struct umbu_output output;
    struct umbu_json json;
};

/* A kind of records. */
struct kind {
    const char *name;    /* in messages and JSON */
    size_t answer_bytes; /* bytes of an answer */
    size_t slice;        /* records of a file between two updates of the progress line */
    /* Checks that the file's asset takes such records; NULL: each does. */
    enum umb_status (*prepare)(struct job *job, struct umb_error *error);
    enum umb_status (*check)(const struct records *records, struct umb_error *error);
    enum umb_status (*ask_file)(struct job *job, const struct records *records, size_t first,
                                size_t count, struct umb_error *error);
    enum umb_status (*ask_daemon)(struct umb_client *client, const struct umb_volume_query *query,
                                  const struct records *records,
                                  struct umb_volume_query_reply *reply, struct umb_error *error);
    /* Prints the answer of record i. */
    enum umb_status (*put)(struct job *job, const struct records *records, size_t i,
                           struct umb_error *error);
};

/* Stores the id of the asset that answered. Fails if an earlier reply came from an asset with
 * another id. */
static enum umb_status take_reply(struct job *job, const struct umb_volume_query_reply *reply,
                                  struct umb_error *error)
{
    if (job->has_id && memcmp(job->id, reply->asset_id, UMB_ID_BYTES) != 0) {
        /* Asking again helps: the exit code is 75. */
        return umb_fail(error, UMB_E_CANCELLED,
                        "asset '%.200s' was replaced during the query; ask again",
                        job->options->target);
    }
    memcpy(job->id, reply->asset_id, UMB_ID_BYTES);
    job->has_id = true;
    job->ignores_translucent = reply->ignores_translucent;
    return UMB_OK;
}

/* Answers records. The counts are added to the sums in their answers. */
static enum umb_status ask(struct job *job, const struct records *records, bool shown,
                           struct umb_error *error)
{
    UMB__TRY(job->kind->check(records, error));
    if (job->client != NULL) {
        const struct umb_volume_query query = {.asset = job->options->target,
                                               .light = job->options->settings.light};
        struct umb_volume_query_reply reply;
        UMB__TRY(job->kind->ask_daemon(job->client, &query, records, &reply, error));
        return take_reply(job, &reply, error);
    }
    for (size_t i = 0, n; i < records->count; i += n) {
        n = records->count - i < job->kind->slice ? records->count - i : job->kind->slice;
        UMB__TRY(job->kind->ask_file(job, records, i, n, error));
        if (shown) {
            umbc_records_show(&job->progress, (double)(i + n));
        }
    }
    return UMB_OK;
}

/* --- segments with more intervals than the batch has room for --- */

#define FEW 64 /* fewest intervals that a daemon counts for a segment */
/* Most intervals of the segments of one call, unless one segment has more. */
#define LONG_INTERVALS ((size_t)1 << 18)

static void finish_longs(struct long_segments *longs)
{
    free(longs->ends);
    free(longs->answers.segments);
    free(longs->answers.intervals);
    *longs = (struct long_segments){0};
}

/* Returns true if one more segment fits into the call. Each segment of a call gets room for as many
 * intervals as the call's largest segment has. At least half of that room must be used, because a
 * daemon counts the whole room as points. */
static bool has_room(const struct job *job, size_t count, size_t most, size_t used)
{
    const size_t room = count * most;
    return count == 1 || (room <= LONG_INTERVALS && room / 2 <= used &&
                          (job->client == NULL || room <= job->limits.max_points));
}

/* Counts the long segments (struct long_segments) from number i on that fit into one call, and
 * finds the greatest number of intervals of one of them. */
static void choose_longs(struct job *job, size_t count, size_t i)
{
    struct long_segments *longs = &job->longs;
    size_t used = 0, most = FEW;
    for (; i < count; i++) {
        const size_t intervals = (size_t)job->segments.segments[i].interval_count;
        const size_t longest = intervals > most ? intervals : most;
        if (intervals > INTERVALS_KEPT) {
            used += intervals > FEW ? intervals : FEW;
            if (!has_room(job, longs->count + 1, longest, used)) {
                break;
            }
            most = longest;
            longs->count++;
        }
    }
    longs->answers.interval_max = most;
}

/* Queries the long segments (struct long_segments) from number i on once more, as many as fit into
 * one call. */
static enum umb_status ask_longs(struct job *job, const struct records *batch, size_t i,
                                 struct umb_error *error)
{
    struct long_segments *longs = &job->longs;
    const struct umb_segments *all = &batch->pairs;
    const size_t record = 6 * (all->format == UMB_POINT_F32 ? sizeof(float) : sizeof(double));
    finish_longs(longs);
    choose_longs(job, batch->count, i);
    const size_t room = longs->count * longs->answers.interval_max;
    longs->ends = malloc(longs->count * record);
    longs->answers.segments = calloc(longs->count, sizeof *longs->answers.segments);
    longs->answers.intervals = calloc(room, sizeof *longs->answers.intervals);
    if (longs->ends == NULL || longs->answers.segments == NULL ||
        longs->answers.intervals == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu intervals", room);
    }
    for (size_t found = 0; found < longs->count; i++) {
        if (job->segments.segments[i].interval_count > INTERVALS_KEPT) {
            memcpy(longs->ends + found++ * record, (const uint8_t *)all->ends + i * record, record);
        }
    }
    struct records again = {.count = longs->count, .pairs = *all, .segments = &longs->answers};
    again.pairs.ends = longs->ends;
    again.pairs.count = longs->count;
    UMB__TRY(ask(job, &again, false, error));
    for (size_t k = 0; k < longs->count; k++) {
        const uint64_t intervals = longs->answers.segments[k].interval_count;
        if (intervals > longs->answers.interval_max) {
            return umb_fail(error, UMB_E_PROTOCOL,
                            "the daemon announced at most %zu intervals, and then sent %" PRIu64,
                            longs->answers.interval_max, intervals);
        }
    }
    return UMB_OK;
}

/* --- segments --- */

static enum umb_status check_segments(const struct records *records, struct umb_error *error)
{
    return umb_segments_check(&records->pairs, error);
}

static enum umb_status segments_of_file(struct job *job, const struct records *records,
                                        size_t first, size_t count, struct umb_error *error)
{
    (void)error;
    umb_volume_segments(&job->volume, &records->pairs, first, count, records->segments);
    return UMB_OK;
}

static enum umb_status segments_of_daemon(struct umb_client *client,
                                          const struct umb_volume_query *query,
                                          const struct records *records,
                                          struct umb_volume_query_reply *reply,
                                          struct umb_error *error)
{
    return umb_client_segments(client, query, &records->pairs, records->segments, reply, NULL,
                               error);
}

static enum umb_status put_segment(struct job *job, const struct records *records, size_t i,
                                   struct umb_error *error)
{
    const struct umb_segment_answer *answer = &job->segments.segments[i];
    const struct umb_interval *intervals = job->segments.intervals + i * INTERVALS_KEPT;
    if (answer->interval_count > INTERVALS_KEPT) {
        struct long_segments *longs = &job->longs;
        if (longs->next == longs->count) {
            UMB__TRY(ask_longs(job, records, i, error));
        }
        answer = &longs->answers.segments[longs->next];
        intervals = longs->answers.intervals + longs->next++ * longs->answers.interval_max;
    }
    if (!job->options->json) {
        (void)fprintf(job->output.file, "%.9g", answer->lit);
        for (uint64_t k = 0; k < answer->interval_count; k++) {
            (void)fprintf(job->output.file, " %.9g %.9g", intervals[k].begin, intervals[k].end);
        }
        (void)fputc('\n', job->output.file);
        return UMB_OK;
    }
    umbu_json_begin(&job->json, NULL, '{');
    UMBU_JSON_VALUES(&job->json, 17, {"lit", answer->lit}, {"lit_m", answer->lit_m});
    umbu_json_begin(&job->json, "stretches", '[');
    for (uint64_t k = 0; k < answer->interval_count; k++) {
        umbu_json_begin(&job->json, NULL, '[');
        UMBU_JSON_VALUES(&job->json, 17, {NULL, intervals[k].begin}, {NULL, intervals[k].end});
        umbu_json_end(&job->json, ']');
    }
    umbu_json_end(&job->json, ']');
    umbu_json_end(&job->json, '}');
    return UMB_OK;
}

/* --- columns --- */

static enum umb_status prepare_columns(struct job *job, struct umb_error *error)
{
    return umb_volume_check_columns(&job->volume, error);
}

static enum umb_status check_points(const struct records *records, struct umb_error *error)
{
    return umb_points_check(&records->points, error);
}

static enum umb_status columns_of_file(struct job *job, const struct records *records, size_t first,
                                       size_t count, struct umb_error *error)
{
    (void)error;
    umb_volume_columns(&job->volume, &records->points, first, count, records->columns);
    return UMB_OK;
}

static enum umb_status columns_of_daemon(struct umb_client *client,
                                         const struct umb_volume_query *query,
                                         const struct records *records,
                                         struct umb_volume_query_reply *reply,
                                         struct umb_error *error)
{
    return umb_client_columns(client, query, &records->points, records->columns, reply, NULL,
                              error);
}

static enum umb_status put_column(struct job *job, const struct records *records, size_t i,
                                  struct umb_error *error)
{
    const struct umb_column_answer *answer = &records->columns->columns[i];
    (void)error;
    if (!job->options->json) {
        (void)fprintf(job->output.file, "%.9g\n", answer->distance_m);
        return UMB_OK;
    }
    umbu_json_begin(&job->json, NULL, '{');
    umbu_json_number(&job->json, "distance_m", answer->distance_m);
    umbu_json_integer(&job->json, "lit", answer->lit);
    umbu_json_bool(&job->json, "outside", answer->outside != 0);
    umbu_json_end(&job->json, '}');
    return UMB_OK;
}

/* --- boxes --- */

static enum umb_status prepare_boxes(struct job *job, struct umb_error *error)
{
    struct umb_light_info light;
    (void)error;
    UMB__TRY(umb_asset_get_light(job->file, job->options->settings.light, &light));
    return umb_asset_get_frustum(job->file, light.first_frustum, &job->frustum);
}

static enum umb_status check_boxes(const struct records *records, struct umb_error *error)
{
    return umb_boxes_check(records->boxes, records->count, error);
}

/* State of counting one box of a file. */
struct box_count {
    struct job *job;
    size_t box;
    double voxels; /* estimated voxels of the box; 0: not estimated yet */
};

/* Shows the counted share of a box: a large one takes long. */
static int show_box(void *user, uint64_t steps)
{
    struct box_count *count = user;
    struct job *job = count->job;
    const double counted = (double)job->shares.boxes[count->box].voxels;
    (void)steps;
    if (!(count->voxels > 0)) {
        count->voxels = umbc_box_voxels(&job->frustum, job->origin, &job->boxes[count->box]) + 1;
    }
    umbc_records_show(&job->progress, (double)count->box + fmin(counted / count->voxels, 0.99));
    return 1;
}

static enum umb_status boxes_of_file(struct job *job, const struct records *records, size_t first,
                                     size_t count, struct umb_error *error)
{
    struct box_count state = {.job = job, .box = first};
    const struct umb_box_watch watch = {show_box, &state};
    return umb_volume_boxes(&job->volume, records->boxes, first, count, &watch, records->shares,
                            error);
}

static enum umb_status boxes_of_daemon(struct umb_client *client,
                                       const struct umb_volume_query *query,
                                       const struct records *records,
                                       struct umb_volume_query_reply *reply,
                                       struct umb_error *error)
{
    return umb_client_boxes(client, query, records->boxes, records->count, records->shares, reply,
                            NULL, error);
}

static enum umb_status put_box(struct job *job, const struct records *records, size_t i,
                               struct umb_error *error)
{
    const struct umb_box_answer *answer = &records->shares->boxes[i];
    /* Without a voxel there is no share: nan, null in JSON. */
    const double share = (double)answer->lit / (double)answer->voxels;
    (void)error;
    if (!job->options->json) {
        (void)fprintf(job->output.file, answer->voxels ? "%.9g\n" : "nan\n", share);
        return UMB_OK;
    }
    umbu_json_begin(&job->json, NULL, '{');
    umbu_json_number(&job->json, "share", share);
    UMBU_JSON_COUNTS(&job->json, {"lit", answer->lit}, {"voxels", answer->voxels});
    umbu_json_end(&job->json, '}');
    return UMB_OK;
}

/* --- all kinds --- */

static const struct kind KINDS[] = {
    [UMBC_ASK_SEGMENTS] = {"segments", sizeof(struct umb_segment_answer), 256, NULL, check_segments,
                           segments_of_file, segments_of_daemon, put_segment},
    [UMBC_ASK_COLUMNS] = {"columns", sizeof(struct umb_column_answer), 256, prepare_columns,
                          check_points, columns_of_file, columns_of_daemon, put_column},
    [UMBC_ASK_BOXES] = {"boxes", sizeof(struct umb_box_answer), 1, prepare_boxes, check_boxes,
                        boxes_of_file, boxes_of_daemon, put_box},
};

/* Returns the records of the batch. */
static struct records records_of(struct job *job)
{
    const struct umb_points points =
        umbc_batch_view(&job->batch, job->options->format, job->options->origin);
    struct records records = {.count = points.count >> job->source.pairs,
                              .points = points,
                              .boxes = job->boxes,
                              .segments = &job->segments,
                              .columns = &job->columns,
                              .shares = &job->shares};
    records.pairs = (struct umb_segments){
        .ends = points.positions, .format = points.format, .count = records.count};
    memcpy(records.pairs.origin, points.origin, sizeof points.origin);
    if (job->boxes != NULL) {
        umb_boxes_from_corners(&records.pairs, 0, records.count, job->boxes);
    }
    return records;
}

static enum umb_status put_answers(struct job *job, const struct records *records,
                                   struct umb_error *error)
{
    for (size_t i = 0; i < records->count; i++) {
        UMB__TRY(job->kind->put(job, records, i, error));
    }
    return ferror(job->output.file)
               ? umb_fail(error, UMB_E_IO, "cannot write '%.200s'", job->options->out)
               : UMB_OK;
}

static void add_stats(struct umb_volume_stats *sum, struct umb_volume_stats *part)
{
    sum->nodes += part->nodes;
    sum->bricks += part->bricks;
    memset(part, 0, sizeof *part);
}

static enum umb_status ask_batch(struct job *job, struct umb_error *error)
{
    const struct records records = records_of(job);
    enum umb_status status = ask(job, &records, true, error);
    if (status == UMB_OK) {
        status = put_answers(job, &records, error);
    }
    finish_longs(&job->longs);
    job->count += records.count;
    add_stats(&job->stats, &job->segments.stats);
    add_stats(&job->stats, &job->columns.stats);
    add_stats(&job->stats, &job->shares.stats);
    /* Numbers that cannot be used, and a single record that is too large, are errors of the input,
     * not of the command line. */
    return status == (job->client == NULL ? UMB_E_ARGUMENT : UMB_E_TOO_LARGE) ? UMB_E_FORMAT
                                                                              : status;
}

static enum umb_status open_file(struct job *job, struct umb_error *error)
{
    struct umb_asset_info info;
    const enum umb_status status =
        umb_asset_open_file(job->options->target, NULL, &job->file, error);
    if (status != UMB_OK) {
        job->bad_file = true;
        return status;
    }
    umb_asset_get_info(job->file, &info);
    memcpy(job->id, info.id, sizeof info.id);
    memcpy(job->origin, info.origin, sizeof info.origin);
    UMB__TRY(umb_volume_prepare(job->file, job->options->settings.light, &job->volume, error));
    job->ignores_translucent = umb_volume_ignores_translucent(&job->volume);
    return job->kind->prepare != NULL ? job->kind->prepare(job, error) : UMB_OK;
}

static enum umb_status connect_to(struct job *job, struct umb_error *error)
{
    UMB__TRY(umbu_connect(&job->options->session, &job->client, error));
    UMB__TRY(umb_client_get_limits(job->client, &job->limits, error));
    return umbc_call_size(job->options, &job->limits, &job->batch_size, error);
}

static enum umb_status open_answers(struct job *job, struct umb_error *error)
{
    const size_t count = job->batch_size;
    const bool boxes = job->options->volume_query == UMBC_ASK_BOXES;
    const bool segments = job->options->volume_query == UMBC_ASK_SEGMENTS;
    job->answers = calloc(count, job->kind->answer_bytes);
    job->boxes = boxes ? calloc(count, sizeof *job->boxes) : NULL;
    job->columns.columns = job->answers;
    job->shares.boxes = job->answers;
    job->segments.segments = job->answers;
    job->segments.interval_max = INTERVALS_KEPT;
    job->segments.intervals =
        segments ? calloc(count, INTERVALS_KEPT * sizeof *job->segments.intervals) : NULL;
    if (job->answers == NULL || (boxes && job->boxes == NULL) ||
        (segments && job->segments.intervals == NULL)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu answers", count);
    }
    return umbc_batch_init(&job->batch, job->source.pairs ? 2 * count : count, job->options->format,
                           error);
}

static void end_json(struct job *job)
{
    umbu_json_end(&job->json, ']');
    umbc_json_id(&job->json, "asset", job->id);
    umbu_json_integer(&job->json, "light", job->options->settings.light);
    umbu_json_bool(&job->json, "ignores_translucent", job->ignores_translucent);
    umbu_json_integer(&job->json, "count", job->count);
    umbu_json_begin(&job->json, "stats", '{');
    UMBU_JSON_COUNTS(&job->json, {"nodes", job->stats.nodes}, {"bricks", job->stats.bricks});
    umbu_json_close(&job->json);
}

static enum umb_status ask_all(struct job *job, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    if (job->options->json) {
        job->json.file = job->output.file;
        umbu_json_begin(&job->json, NULL, '{');
        umbu_json_begin(&job->json, job->kind->name, '[');
    }
    umbc_records_begin(&job->progress, job->kind->name, job->options->quiet, &job->source);
    do {
        status = umbc_points_read(&job->source, &job->batch, error);
        const size_t count = job->batch.count >> job->source.pairs;
        umbc_records_batch(&job->progress, count);
        if (status == UMB_OK && count > 0) {
            status = ask_batch(job, error);
        }
        umbc_records_show(&job->progress, (double)count);
    } while (status == UMB_OK && job->batch.count > 0);
    if (status == UMB_OK && job->client != NULL && !job->has_id) {
        /* Without records: an empty call refuses a wrong asset or light. */
        status = ask_batch(job, error);
    }
    const double seconds = umbu_clock_s() - job->progress.line.started_s;
    umbc_records_end(&job->progress);
    if (status != UMB_OK) {
        return status;
    }
    if (job->options->json) {
        end_json(job);
    }
    if (!job->options->quiet) {
        (void)fprintf(stderr,
                      "%" PRIu64 " %s in %.3f s, %" PRIu64 " nodes and %" PRIu64 " bricks read\n",
                      job->count, job->kind->name, seconds, job->stats.nodes, job->stats.bricks);
        if (job->ignores_translucent && !job->options->settings.opaque_only) {
            (void)fprintf(stderr, "note: answers are of opaque casters; the light also has "
                                  "translucent ones (--opaque-only says that you know)\n");
        }
    }
    return umbu_output_commit(&job->output, error);
}

static enum umb_status run_job(struct job *job, struct umb_error *error)
{
    const struct umbc_query_options *options = job->options;
    job->batch_size = options->batch;
    UMB__TRY(umbc_is_file(options->target) ? open_file(job, error) : connect_to(job, error));
    UMB__TRY(umbc_points_open(options->points, options->format, false, &job->source, error));
    job->source.pairs = options->volume_query != UMBC_ASK_COLUMNS;
    UMB__TRY(open_answers(job, error));
    UMB__TRY(umbu_output_begin(options->out, UMBU_OUTPUT_COMMAND, &job->output, error));
    return ask_all(job, error);
}

static void close_job(struct job *job)
{
    umbu_json_close(&job->json);
    umbu_output_abandon(&job->output);
    umbc_points_close(&job->source);
    umbc_batch_finish(&job->batch);
    free(job->answers);
    free(job->segments.intervals);
    free(job->boxes);
    umb_client_close(job->client);
    umb_asset_close(job->file);
    free(job);
}

int umbc_query_volume(const struct umbc_query_options *options)
{
    struct umb_error error = {.status = UMB_OK};
    struct job *job = calloc(1, sizeof *job);
    if (job == NULL) {
        return umbc_complain_as(UMB_E_NO_MEMORY, "query: out of memory");
    }
    job->options = options;
    job->kind = &KINDS[options->volume_query];
    const enum umb_status status = run_job(job, &error);
    const bool bad_file = job->bad_file;
    close_job(job);
    if (status != UMB_OK) {
        error.status = status;
        return bad_file ? umbc_complain_file(options->target, &error) : umbc_complain_query(&error);
    }
    return umbc_finish_stdout(0);
}
