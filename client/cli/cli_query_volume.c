/* SPDX-License-Identifier: Apache-2.0 */
/* Segments, columns and boxes from a file or a daemon; see cli_query_options.h. */
#include "cli_query_options.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include "tool/json.h"
#include "tool/clock.h"
#include "tool/output.h"
#include "cli_volume_asset.h"
#include "tool/tool_try.h"

struct job {
    const struct umbc_query_options *options;
    struct umbc_volume_asset asset;
    struct umbc_points source;
    struct umbc_record_progress progress;
    struct umbc_batch batch;
    struct umbu_output output;
    struct umbu_json json;
    struct umb_segment_answers segments;
    struct umb_column_answers columns;
    struct umb_box_answers boxes;
    struct umb_volume_stats stats;
    uint64_t count;
};

/* Names of the records, in messages and JSON. */
static const char *const NAMES[] = {"points", "segments", "columns", "boxes"};

static void add_stats(struct umb_volume_stats *sum, struct umb_volume_stats *part)
{
    sum->nodes += part->nodes;
    sum->bricks += part->bricks;
    memset(part, 0, sizeof *part);
}

/* Returns the batch as pairs of points. */
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
                        const struct umb_interval *intervals)
{
    if (!job->options->json) {
        (void)fprintf(job->output.file, "%.9g", answer->lit);
        for (uint64_t k = 0; k < answer->interval_count; k++) {
            (void)fprintf(job->output.file, " %.9g %.9g", intervals[k].begin, intervals[k].end);
        }
        (void)fputc('\n', job->output.file);
        return;
    }
    umbu_json_begin(&job->json, NULL, '{');
    umbu_json_number(&job->json, "lit", answer->lit);
    umbu_json_number(&job->json, "lit_m", answer->lit_m);
    umbu_json_begin(&job->json, "stretches", '[');
    for (uint64_t k = 0; k < answer->interval_count; k++) {
        umbu_json_begin(&job->json, NULL, '[');
        umbu_json_number(&job->json, NULL, intervals[k].begin);
        umbu_json_number(&job->json, NULL, intervals[k].end);
        umbu_json_end(&job->json, ']');
    }
    umbu_json_end(&job->json, ']');
    umbu_json_end(&job->json, '}');
}

static enum umb_status ask_segments(struct job *job, struct umb_error *error)
{
    const struct umb_segments segments = pairs_of(job);
    enum umb_status status =
        umbc_volume_segments(&job->asset, &segments, &job->progress, &job->segments, error);
    struct umbc_long_segments longs = {.segments = &segments, .answers = &job->segments};
    for (size_t i = 0; status == UMB_OK && i < segments.count; i++) {
        const struct umb_segment_answer *answer = &job->segments.segments[i];
        const struct umb_interval *intervals = job->segments.intervals + i * UMBC_INTERVALS_KEPT;
        if (answer->interval_count > UMBC_INTERVALS_KEPT) {
            status = umbc_longs_next(&longs, &job->asset, i, &answer, &intervals, error);
        }
        if (status == UMB_OK) {
            put_segment(job, answer, intervals);
        }
    }
    umbc_longs_finish(&longs);
    job->count += segments.count;
    add_stats(&job->stats, &job->segments.stats);
    return status;
}

static enum umb_status ask_columns(struct job *job, struct umb_error *error)
{
    struct umb_points points =
        umbc_batch_view(&job->batch, job->options->format, job->options->origin);
    UMB__TRY(umbc_volume_columns(&job->asset, &points, &job->progress, &job->columns, error));
    for (size_t i = 0; i < points.count; i++) {
        const struct umb_column_answer *answer = &job->columns.columns[i];
        if (!job->options->json) {
            (void)fprintf(job->output.file, "%.9g\n", answer->distance_m);
            continue;
        }
        umbu_json_begin(&job->json, NULL, '{');
        umbu_json_number(&job->json, "distance_m", answer->distance_m);
        umbu_json_integer(&job->json, "lit", answer->lit);
        umbu_json_bool(&job->json, "outside", answer->outside != 0);
        umbu_json_end(&job->json, '}');
    }
    job->count += points.count;
    add_stats(&job->stats, &job->columns.stats);
    return UMB_OK;
}

static enum umb_status ask_boxes(struct job *job, struct umb_error *error)
{
    const struct umb_segments corners = pairs_of(job);
    UMB__TRY(umbc_volume_boxes(&job->asset, &corners, &job->progress, &job->boxes, error));
    for (size_t i = 0; i < corners.count; i++) {
        const struct umb_box_answer *answer = &job->boxes.boxes[i];
        /* Without a voxel there is no share: nan, null in JSON. */
        double share = (double)answer->lit / (double)answer->voxels;
        if (!job->options->json) {
            (void)fprintf(job->output.file, answer->voxels ? "%.9g\n" : "nan\n", share);
            continue;
        }
        umbu_json_begin(&job->json, NULL, '{');
        umbu_json_number(&job->json, "share", share);
        umbu_json_integer(&job->json, "lit", answer->lit);
        umbu_json_integer(&job->json, "voxels", answer->voxels);
        umbu_json_end(&job->json, '}');
    }
    job->count += corners.count;
    add_stats(&job->stats, &job->boxes.stats);
    return UMB_OK;
}

static enum umb_status ask_batch(struct job *job, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    switch (job->options->volume_query) {
    case UMBC_ASK_SEGMENTS:
        status = ask_segments(job, error);
        break;
    case UMBC_ASK_COLUMNS:
        status = ask_columns(job, error);
        break;
    default:
        status = ask_boxes(job, error);
        break;
    }
    if (status == UMB_E_ARGUMENT && job->asset.client == NULL) {
        return UMB_E_FORMAT; /* an error of the input, not of the command line */
    }
    if (status == UMB_E_TOO_LARGE && job->asset.client != NULL) {
        return UMB_E_FORMAT; /* the input has one record that is too large */
    }
    if (status == UMB_OK && ferror(job->output.file)) {
        status = umb_fail(error, UMB_E_IO, "cannot write '%.200s'", job->options->out);
    }
    return status;
}

static enum umb_status open_answers(struct job *job, struct umb_error *error)
{
    const size_t count = job->asset.batch_size;
    bool good = true;
    switch (job->options->volume_query) {
    case UMBC_ASK_SEGMENTS:
        job->segments.segments = calloc(count, sizeof *job->segments.segments);
        job->segments.intervals =
            calloc(count, UMBC_INTERVALS_KEPT * sizeof *job->segments.intervals);
        job->segments.interval_max = UMBC_INTERVALS_KEPT;
        good = job->segments.segments != NULL && job->segments.intervals != NULL;
        break;
    case UMBC_ASK_COLUMNS:
        job->columns.columns = calloc(count, sizeof *job->columns.columns);
        good = job->columns.columns != NULL;
        break;
    default:
        job->boxes.boxes = calloc(count, sizeof *job->boxes.boxes);
        good = job->boxes.boxes != NULL;
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
    umbu_json_end(&job->json, ']');
    umbc_json_id(&job->json, "asset", job->asset.id);
    umbu_json_integer(&job->json, "light", job->options->settings.light);
    umbu_json_bool(&job->json, "ignores_translucent", job->asset.ignores_translucent);
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
        umbu_json_begin(&job->json, NAMES[job->options->volume_query], '[');
    }
    umbc_records_begin(&job->progress, NAMES[job->options->volume_query], job->options->quiet,
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
    if (status == UMB_OK && job->asset.client != NULL && !job->asset.has_id) {
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
                      job->count, NAMES[job->options->volume_query], seconds, job->stats.nodes,
                      job->stats.bricks);
        if (job->asset.ignores_translucent && !job->options->settings.opaque_only) {
            (void)fprintf(stderr, "note: answers are of opaque casters; the light also has "
                                  "translucent ones (--opaque-only says that you know)\n");
        }
    }
    return umbu_output_commit(&job->output, error);
}

static enum umb_status run_job(struct job *job, struct umb_error *error)
{
    const struct umbc_query_options *options = job->options;
    UMB__TRY(umbc_volume_open(options, &job->asset, error));
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
    free(job->segments.segments);
    free(job->segments.intervals);
    free(job->columns.columns);
    free(job->boxes.boxes);
    umbc_volume_close(&job->asset);
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
    bool bad_file = job->asset.bad_file;
    close_job(job);
    if (status != UMB_OK) {
        error.status = status;
        return bad_file ? umbc_complain_file(options->target, &error) : umbc_complain_query(&error);
    }
    return umbc_finish_stdout(0);
}
