/* SPDX-License-Identifier: Apache-2.0 */
/* Segments, columns and boxes from a file or a daemon; see cli_query_volume.h. */
#include "cli_query_volume.h"
#include "cli_option_names.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "cli_call_size.h"
#include "cli_json.h"
#include "cli_output.h"
#include "cli_record_progress.h"
#include "cli_session.h"
#include "umbrage/questions.h"

/* Stretches kept of each segment; those with more are asked again with room for all. */
#define KEPT 16
#define FEW  64 /* a daemon counts segments of fewer stretches as of so many */
/* Stretches that such segments may have together, unless one has more. */
#define LONG_STRETCHES ((size_t)1 << 18)
/* Records of a file that are answered between two looks at the clock; of boxes it is one. */
#define SLICE ((size_t)256)

/* Segments of more stretches than are kept, one behind the other, answered together. */
struct longs {
    uint8_t *ends;
    struct umb_segment_answers answers;
    size_t count, next; /* next: the first that is not told */
};

struct job {
    const struct umbc_query_options *options;
    struct umb_asset *asset; /* a file ... */
    bool bad_file;           /* ... that could not be opened, */
    struct umb_volume volume;
    struct umb_frustum_info frustum; /* the light's, for boxes */
    double origin[3];                /* the asset's */
    struct umb_client *client;       /* or a daemon, */
    struct umb_client_limits limits; /* which takes so much */
    size_t batch_size;               /* records asked together */
    uint8_t asset_id[UMB_ID_BYTES];
    bool has_id; /* the daemon has answered once */
    bool ignores_translucent;
    struct umbc_points source;
    struct umbc_record_progress progress;
    struct umbc_batch batch;
    struct umbc_output output;
    struct umbc_json json;
    struct umb_segment_answers segments;
    struct longs longs;
    struct umb_column_answers columns;
    struct umb_box_answers boxes;
    struct umb_box *corners; /* of a file */
    size_t box;              /* the one that is counted */
    double box_voxels;       /* about what it will have; 0: not known yet */
    struct umb_volume_stats stats;
    uint64_t count;
};

/* Also for each record: a name in JSON. */
static const char *const NAMES[] = {"points", "segments", "columns", "boxes"};

static void add_stats(struct umb_volume_stats *sum, struct umb_volume_stats *part)
{
    sum->nodes += part->nodes;
    sum->bricks += part->bricks;
    memset(part, 0, sizeof *part);
}

/* Notes who answered. All of it must be one version. */
static enum umb_status take_reply(struct job *job, const struct umb_question_reply *reply,
                                  struct umb_error *error)
{
    if (job->has_id && memcmp(job->asset_id, reply->asset_id, UMB_ID_BYTES) != 0) {
        /* Asking again helps, so that the exit code must say 75. */
        return umb_fail(error, UMB_E_CANCELLED,
                        "asset '%.200s' was replaced during the query; ask again",
                        job->options->target);
    }
    memcpy(job->asset_id, reply->asset_id, UMB_ID_BYTES);
    job->has_id = true;
    job->ignores_translucent = reply->ignores_translucent;
    return UMB_OK;
}

static struct umb_question question_of(const struct job *job)
{
    return (struct umb_question){.asset = job->options->target,
                                 .light = job->options->settings.light};
}

static enum umb_status answer_segments(struct job *job, const struct umb_segments *segments,
                                       struct umb_segment_answers *answers, struct umb_error *error)
{
    if (job->client == NULL) {
        enum umb_status status = umb_segments_check(segments, error);
        for (size_t i = 0, n; status == UMB_OK && i < segments->count; i += n) {
            n = segments->count - i < SLICE ? segments->count - i : SLICE;
            umb_segments_run(&job->volume, segments, i, n, answers);
            if (answers == &job->segments) { /* not those that are asked again */
                umbc_records_show(&job->progress, (double)(i + n));
            }
        }
        return status;
    }
    const struct umb_question question = question_of(job);
    struct umb_question_reply reply;
    enum umb_status status =
        umb_client_segments(job->client, &question, segments, answers, &reply, error);
    return status == UMB_OK ? take_reply(job, &reply, error) : status;
}

static enum umb_status answer_columns(struct job *job, const struct umb_points *points,
                                      struct umb_error *error)
{
    if (job->client == NULL) {
        enum umb_status status = umb_points_check(points, error);
        for (size_t i = 0, n; status == UMB_OK && i < points->count; i += n) {
            n = points->count - i < SLICE ? points->count - i : SLICE;
            umb_columns_run(&job->volume, points, i, n, &job->columns);
            umbc_records_show(&job->progress, (double)(i + n));
        }
        return status;
    }
    const struct umb_question question = question_of(job);
    struct umb_question_reply reply;
    enum umb_status status =
        umb_client_columns(job->client, &question, points, &job->columns, &reply, error);
    return status == UMB_OK ? take_reply(job, &reply, error) : status;
}

/* A large box takes long: shows how much of it is counted. */
static int show_box(void *user, uint64_t steps)
{
    struct job *job = user;
    const double counted = (double)job->boxes.boxes[job->box].voxels;
    (void)steps;
    if (!(job->box_voxels > 0)) {
        job->box_voxels = umbc_box_voxels(&job->frustum, job->origin, &job->corners[job->box]) + 1;
    }
    umbc_records_show(&job->progress, (double)job->box + fmin(counted / job->box_voxels, 0.99));
    return 1;
}

static enum umb_status answer_boxes(struct job *job, const struct umb_segments *corners,
                                    struct umb_error *error)
{
    if (job->client == NULL) {
        enum umb_status status = umb_corners_check(corners, error);
        if (status == UMB_OK) {
            umb_corners_get(corners, 0, corners->count, job->corners);
        }
        for (size_t i = 0; status == UMB_OK && i < corners->count; i++) {
            job->box = i;
            job->box_voxels = 0;
            umb_boxes_run(&job->volume, job->corners, i, 1, &job->boxes);
            umbc_records_show(&job->progress, (double)(i + 1));
        }
        return status;
    }
    const struct umb_question question = question_of(job);
    struct umb_question_reply reply;
    enum umb_status status =
        umb_client_boxes(job->client, &question, corners, &job->boxes, &reply, error);
    return status == UMB_OK ? take_reply(job, &reply, error) : status;
}

/* The batch as pairs of points. */
static struct umb_segments pairs_of(const struct job *job)
{
    const struct umb_points ends =
        umbc_batch_view(&job->batch, job->options->format, job->options->origin);
    struct umb_segments pairs = {
        .ends = ends.positions, .format = ends.format, .count = ends.count / 2};
    memcpy(pairs.origin, ends.origin, sizeof pairs.origin);
    return pairs;
}

static void put_segment(struct job *job, const struct umb_segment_answer *answer,
                        const struct umb_stretch *stretches)
{
    if (!job->options->json) {
        (void)fprintf(job->output.file, "%.9g", answer->lit);
        for (uint64_t k = 0; k < answer->stretch_count; k++) {
            (void)fprintf(job->output.file, " %.9g %.9g", stretches[k].begin, stretches[k].end);
        }
        (void)fputc('\n', job->output.file);
        return;
    }
    umbc_json_begin(&job->json, NULL, '{');
    umbc_json_number(&job->json, "lit", answer->lit);
    umbc_json_number(&job->json, "lit_m", answer->lit_m);
    umbc_json_begin(&job->json, "stretches", '[');
    for (uint64_t k = 0; k < answer->stretch_count; k++) {
        umbc_json_begin(&job->json, NULL, '[');
        umbc_json_number(&job->json, NULL, stretches[k].begin);
        umbc_json_number(&job->json, NULL, stretches[k].end);
        umbc_json_end(&job->json, ']');
    }
    umbc_json_end(&job->json, ']');
    umbc_json_end(&job->json, '}');
}

static void longs_finish(struct longs *longs)
{
    free(longs->ends);
    free(longs->answers.segments);
    free(longs->answers.stretches);
    memset(longs, 0, sizeof *longs);
}

/* 1 if one more segment fits: each has room for the most stretches of any, of which half at least
 * is used, and a daemon counts it as so many points. */
static bool has_room(const struct job *job, size_t count, size_t most, size_t used)
{
    const size_t room = count * most;
    return count == 1 || (room <= LONG_STRETCHES && room / 2 <= used &&
                          (job->client == NULL || room <= job->limits.max_points));
}

/* Counts the long segments from i on that are asked together, and the stretches of the longest. */
static void longs_choose(const struct job *job, size_t i, size_t end, struct longs *longs)
{
    size_t used = 0, most = FEW;
    longs->count = 0;
    for (; i < end; i++) {
        const size_t stretches = (size_t)job->segments.segments[i].stretch_count;
        const size_t longest = stretches > most ? stretches : most;
        if (stretches > KEPT) {
            used += stretches > FEW ? stretches : FEW;
            if (!has_room(job, longs->count + 1, longest, used)) {
                break;
            }
            most = longest;
            longs->count++;
        }
    }
    longs->answers.stretch_max = most;
}

/* What was asked with room for all stretches must have no more now, whatever a server says. */
static enum umb_status longs_check(const struct longs *longs, struct umb_error *error)
{
    for (size_t i = 0; i < longs->count; i++) {
        const uint64_t stretches = longs->answers.segments[i].stretch_count;
        if (stretches > longs->answers.stretch_max) {
            return umb_fail(error, UMB_E_PROTOCOL,
                            "the daemon told %zu stretches at most, and then %" PRIu64,
                            longs->answers.stretch_max, stretches);
        }
    }
    return UMB_OK;
}

/* Asks the long segments from i on once more, as many as go together. */
static enum umb_status longs_ask(struct job *job, const struct umb_segments *segments, size_t i,
                                 struct umb_error *error)
{
    const size_t record = 6 * (segments->format == UMB_POINT_F32 ? sizeof(float) : sizeof(double));
    struct longs *longs = &job->longs;
    longs_finish(longs);
    longs_choose(job, i, segments->count, longs);
    const size_t room = longs->count * longs->answers.stretch_max;
    longs->ends = malloc(longs->count * record);
    longs->answers.segments = calloc(longs->count, sizeof *longs->answers.segments);
    longs->answers.stretches = calloc(room, sizeof *longs->answers.stretches);
    if (longs->ends == NULL || longs->answers.segments == NULL ||
        longs->answers.stretches == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu stretches", room);
    }
    for (size_t found = 0; found < longs->count; i++) {
        if (job->segments.segments[i].stretch_count > KEPT) {
            memcpy(longs->ends + found++ * record, (const uint8_t *)segments->ends + i * record,
                   record);
        }
    }
    struct umb_segments again = *segments;
    again.ends = longs->ends;
    again.count = longs->count;
    const enum umb_status status = answer_segments(job, &again, &longs->answers, error);
    return status == UMB_OK ? longs_check(longs, error) : status;
}

static enum umb_status ask_segments(struct job *job, struct umb_error *error)
{
    const struct umb_segments segments = pairs_of(job);
    struct longs *longs = &job->longs;
    enum umb_status status = answer_segments(job, &segments, &job->segments, error);
    longs_finish(longs);
    for (size_t i = 0; status == UMB_OK && i < segments.count; i++) {
        if (job->segments.segments[i].stretch_count <= KEPT) {
            put_segment(job, &job->segments.segments[i], job->segments.stretches + i * KEPT);
            continue;
        }
        if (longs->next == longs->count) {
            status = longs_ask(job, &segments, i, error);
        }
        if (status == UMB_OK) {
            put_segment(job, &longs->answers.segments[longs->next],
                        longs->answers.stretches + longs->next * longs->answers.stretch_max);
            longs->next++;
        }
    }
    job->count += segments.count;
    add_stats(&job->stats, &job->segments.stats);
    return status;
}

static enum umb_status ask_columns(struct job *job, struct umb_error *error)
{
    struct umb_points points =
        umbc_batch_view(&job->batch, job->options->format, job->options->origin);
    enum umb_status status = answer_columns(job, &points, error);
    if (status != UMB_OK) {
        return status;
    }
    for (size_t i = 0; i < points.count; i++) {
        const struct umb_column_answer *answer = &job->columns.columns[i];
        if (!job->options->json) {
            (void)fprintf(job->output.file, "%.9g\n", answer->distance_m);
            continue;
        }
        umbc_json_begin(&job->json, NULL, '{');
        umbc_json_number(&job->json, "distance_m", answer->distance_m);
        umbc_json_integer(&job->json, "lit", answer->lit);
        umbc_json_bool(&job->json, "outside", answer->outside != 0);
        umbc_json_end(&job->json, '}');
    }
    job->count += points.count;
    add_stats(&job->stats, &job->columns.stats);
    return UMB_OK;
}

static enum umb_status ask_boxes(struct job *job, struct umb_error *error)
{
    const struct umb_segments corners = pairs_of(job);
    enum umb_status status = answer_boxes(job, &corners, error);
    if (status != UMB_OK) {
        return status;
    }
    for (size_t i = 0; i < corners.count; i++) {
        const struct umb_box_answer *answer = &job->boxes.boxes[i];
        /* Without a voxel there is no share: nan, null in JSON. */
        double share = (double)answer->lit / (double)answer->voxels;
        if (!job->options->json) {
            (void)fprintf(job->output.file, answer->voxels ? "%.9g\n" : "nan\n", share);
            continue;
        }
        umbc_json_begin(&job->json, NULL, '{');
        umbc_json_number(&job->json, "share", share);
        umbc_json_integer(&job->json, "lit", answer->lit);
        umbc_json_integer(&job->json, "voxels", answer->voxels);
        umbc_json_end(&job->json, '}');
    }
    job->count += corners.count;
    add_stats(&job->stats, &job->boxes.stats);
    return UMB_OK;
}

static enum umb_status ask_batch(struct job *job, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    switch (job->options->question) {
    case UMBC_QUESTION_SEGMENTS:
        status = ask_segments(job, error);
        break;
    case UMBC_QUESTION_COLUMNS:
        status = ask_columns(job, error);
        break;
    default:
        status = ask_boxes(job, error);
        break;
    }
    if (status == UMB_E_ARGUMENT && job->client == NULL) {
        return UMB_E_FORMAT; /* the input's fault, not the command line's */
    }
    if (status == UMB_E_TOO_LARGE && job->client != NULL) {
        return UMB_E_FORMAT; /* likewise: not too many records, but one that is too large */
    }
    if (status == UMB_OK && ferror(job->output.file)) {
        status = umb_fail(error, UMB_E_IO, "cannot write '%.200s'", job->options->out);
    }
    return status;
}

/* Of the light, which is directional and has one. */
static enum umb_status first_frustum(struct job *job, struct umb_error *error)
{
    struct umb_light_info light;
    enum umb_status status = umb_asset_get_light(job->asset, job->options->settings.light, &light);
    if (status == UMB_OK) {
        status = umb_asset_get_frustum(job->asset, light.first_frustum, &job->frustum);
    }
    return status == UMB_OK ? status : umb_fail(error, status, "the light has no frustum");
}

static enum umb_status open_asset(struct job *job, struct umb_error *error)
{
    const struct umbc_query_options *options = job->options;
    struct umb_asset_info info;
    enum umb_status status = UMB_OK;
    job->batch_size = options->batch;
    if (!umbc_is_file(options->target)) {
        status = umbc_connect(options->session, &job->client, error);
        if (status == UMB_OK) {
            status = umb_client_get_limits(job->client, &job->limits, error);
        }
        return status == UMB_OK ? umbc_call_size(options, &job->limits, &job->batch_size, error)
                                : status;
    }
    status = umb_asset_open_file(options->target, NULL, &job->asset, error);
    if (status != UMB_OK) {
        job->bad_file = true;
        return status;
    }
    umb_asset_get_info(job->asset, &info);
    memcpy(job->asset_id, info.id, sizeof info.id);
    memcpy(job->origin, info.origin, sizeof info.origin);
    status = umb_volume_prepare(job->asset, options->settings.light, &job->volume, error);
    job->ignores_translucent = status == UMB_OK && umb_volume_ignores_translucent(&job->volume);
    if (status == UMB_OK && options->question == UMBC_QUESTION_BOXES) {
        status = umb_volume_check_parallel(&job->volume, error);
        if (status == UMB_OK) {
            status = first_frustum(job, error);
        }
    }
    if (status == UMB_OK && options->question == UMBC_QUESTION_COLUMNS) {
        status = umb_columns_check(&job->volume, error);
    }
    return status;
}

static enum umb_status open_answers(struct job *job, struct umb_error *error)
{
    const size_t count = job->batch_size;
    bool good = true;
    switch (job->options->question) {
    case UMBC_QUESTION_SEGMENTS:
        job->segments.segments = calloc(count, sizeof *job->segments.segments);
        job->segments.stretches = calloc(count, KEPT * sizeof *job->segments.stretches);
        job->segments.stretch_max = KEPT;
        good = job->segments.segments != NULL && job->segments.stretches != NULL;
        break;
    case UMBC_QUESTION_COLUMNS:
        job->columns.columns = calloc(count, sizeof *job->columns.columns);
        good = job->columns.columns != NULL;
        break;
    default:
        job->corners = calloc(count, sizeof *job->corners);
        job->boxes.boxes = calloc(count, sizeof *job->boxes.boxes);
        job->boxes.go_on = show_box;
        job->boxes.go_on_user = job;
        good = job->corners != NULL && job->boxes.boxes != NULL;
        break;
    }
    if (!good) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu answers", count);
    }
    return umbc_batch_init(&job->batch, job->source.pairs ? 2 * count : count, job->options->format,
                           error);
}

static void end_json(struct job *job)
{
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(job->asset_id, id);
    umbc_json_end(&job->json, ']');
    umbc_json_text(&job->json, "asset", id);
    umbc_json_integer(&job->json, "light", job->options->settings.light);
    umbc_json_bool(&job->json, "ignores_translucent", job->ignores_translucent);
    umbc_json_integer(&job->json, "count", job->count);
    umbc_json_begin(&job->json, "stats", '{');
    umbc_json_integer(&job->json, "nodes", job->stats.nodes);
    umbc_json_integer(&job->json, "bricks", job->stats.bricks);
    umbc_json_end(&job->json, '}');
    umbc_json_end(&job->json, '}');
    (void)fputc('\n', job->json.file);
}

static enum umb_status ask_all(struct job *job, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    if (job->options->json) {
        job->json.file = job->output.file;
        umbc_json_begin(&job->json, NULL, '{');
        umbc_json_begin(&job->json, NAMES[job->options->question], '[');
    }
    umbc_records_begin(&job->progress, NAMES[job->options->question], job->options->quiet,
                       &job->source);
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
        /* Nothing was sent; an empty question still refuses a wrong asset or light. */
        status = ask_batch(job, error);
    }
    const double seconds = umbc_clock_s() - job->progress.line.started_s;
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
                      job->count, NAMES[job->options->question], seconds, job->stats.nodes,
                      job->stats.bricks);
        if (job->ignores_translucent && !job->options->settings.opaque_only) {
            (void)fprintf(stderr, "note: answers are of opaque casters; the light also has "
                                  "translucent ones (--opaque-only says that you know)\n");
        }
    }
    return umbc_output_commit(&job->output, error);
}

static enum umb_status run_job(struct job *job, struct umb_error *error)
{
    const struct umbc_query_options *options = job->options;
    enum umb_status status = open_asset(job, error);
    if (status == UMB_OK) {
        status = umbc_points_open(options->points, options->format, false, &job->source, error);
    }
    job->source.pairs = options->question != UMBC_QUESTION_COLUMNS;
    if (status == UMB_OK) {
        status = open_answers(job, error);
    }
    if (status == UMB_OK) {
        status = umbc_output_begin(options->out, &job->output, error);
    }
    return status == UMB_OK ? ask_all(job, error) : status;
}

static void close_job(struct job *job)
{
    umbc_json_abandon(&job->json);
    umbc_output_abandon(&job->output);
    umbc_points_close(&job->source);
    umbc_batch_finish(&job->batch);
    free(job->segments.segments);
    free(job->segments.stretches);
    longs_finish(&job->longs);
    free(job->columns.columns);
    free(job->boxes.boxes);
    free(job->corners);
    umb_client_close(job->client);
    umb_asset_close(job->asset);
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
    enum umb_status status = run_job(job, &error);
    bool bad_file = job->bad_file;
    close_job(job);
    if (status != UMB_OK) {
        error.status = status;
        return bad_file ? umbc_complain_file(options->target, &error) : umbc_complain_query(&error);
    }
    return umbc_finish_stdout(0);
}
