/* SPDX-License-Identifier: Apache-2.0 */
/* One batch: its memory, and answering it in one step. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/compat.h"
#include "daemon/work/batch.h"
#include "tool/clock.h"

/* Fewest points of a slice: each slice has a fixed cost, and the answers of a slice should fill
 * whole cache lines. */
#define SLICE_POINTS_MIN 256
#define CPU_CLOCK_POINTS 256 /* slices with fewer points are timed by the wall clock */

/* Clears the batch, but neither its parts nor the error at its end. */
static void init_batch(struct umbd_batch *batch, size_t part_limit,
                       const struct umb_query_settings *settings, const struct umb_points *points)
{
    memset(batch, 0, offsetof(struct umbd_batch, task.error));
    batch->parts = (struct umbd_part *)(batch + 1);
    batch->part_limit = part_limit;
    batch->settings = *settings;
    batch->points = *points;
    batch->part_bytes = umb_answer_bytes(settings->format, points->count);
}

enum umb_status umbd_batch_create(size_t part_limit, const struct umb_query_settings *settings,
                                  const struct umb_points *points, struct umbd_batch **out,
                                  struct umb_error *error)
{
    *out = NULL;
    struct umbd_batch *batch = malloc(sizeof *batch + part_limit * sizeof(struct umbd_part));
    if (batch == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a batch");
    }
    init_batch(batch, part_limit, settings, points);
    if (part_limit > 0) {
        batch->parts[0].serial = 0; /* for umbd_batch_repeat */
    }
    *out = batch;
    return UMB_OK;
}

enum umb_status umbd_batch_reuse(struct umbd_batch **spare,
                                 const struct umb_query_settings *settings,
                                 const struct umb_points *points, struct umbd_batch **out,
                                 struct umb_error *error)
{
    if (*spare == NULL) {
        return umbd_batch_create(1, settings, points, out, error);
    }
    *out = *spare;
    *spare = NULL;
    init_batch(*out, 1, settings, points);
    return UMB_OK;
}

/* Returns the number of points of a slice, chosen so that all slices take about equally long,
 * whatever a point costs. */
static size_t slice_points(const struct umbd_batch *batch)
{
    const size_t parts = batch->part_count;
    const size_t points = parts > 0 ? umb_query_slice(&batch->parts[0].query) / parts : 0;
    return points > SLICE_POINTS_MIN ? points - points % SLICE_POINTS_MIN : SLICE_POINTS_MIN;
}

/* Nanoseconds a point for a part's setting, by a calibration. */
static double expected_ns(const struct umbd_part *part, const struct umb_calibration *calibration)
{
    struct umb_curve_row rows[UMB_CURVE_ROWS_MAX];
    size_t count;
    (void)umb_asset_get_curve(umbs_entry_asset(part->entry), part->light, rows, &count);
    for (size_t i = 0; i < count && i < calibration->count; i++) {
        if (rows[i].level == part->level && rows[i].taps == part->taps) {
            return calibration->ns[i];
        }
    }
    return 0;
}

static int has_dial(const struct umbd_batch *batch)
{
    return batch->dial.max_error_m > 0 || batch->dial.max_visibility > 0 ||
           batch->dial.budget_ns > 0;
}

int umbd_batch_repeat(struct umbd_batch *batch, struct umbs_entry *entry, uint64_t serial)
{
    struct umbd_part *part = &batch->parts[0];
    if (part->serial != serial || part->entry != entry || has_dial(batch) ||
        memcmp(&part->asked, &batch->settings, sizeof part->asked) != 0) {
        return 0;
    }
    part->expected_ns = 0;
    batch->part_count = 1;
    batch->value_bytes = batch->part_bytes;
    return 1;
}

enum umb_status umbd_batch_add(struct umbd_batch *batch, struct umbs_entry *entry, uint32_t light,
                               struct umb_error *error)
{
    struct umbd_part *part = &batch->parts[batch->part_count];
    struct umb_query_settings settings = batch->settings;
    settings.light = light;
    part->serial = 0;
    enum umb_status status = UMB_OK;
    if (has_dial(batch)) {
        settings.taps = settings.level = 0;
        status = umb_dial_choose(umbs_entry_asset(entry), &batch->dial, batch->calibration,
                                 &settings, NULL, error);
    }
    if (status == UMB_OK) {
        status = umb_query_prepare(umbs_entry_asset(entry), &settings, &part->query, error);
    }
    if (status != UMB_OK) {
        if (!batch->is_borrowed) {
            umbs_entry_release(entry);
        }
        return status;
    }
    part->entry = entry;
    part->serial = umbs_entry_serial(entry);
    part->asked = settings;
    part->light = light;
    part->taps = settings.taps;
    part->level = settings.level;
    part->expected_ns = batch->calibration != NULL ? expected_ns(part, batch->calibration) : 0;
    batch->settings.light = light;
    batch->settings.taps =
        settings.taps > batch->settings.taps ? settings.taps : batch->settings.taps;
    batch->part_count++;
    batch->value_bytes = batch->part_count * batch->part_bytes;
    return UMB_OK;
}

/* Frees everything the batch owns, but not the batch itself. */
static void finish_batch(struct umbd_batch *batch)
{
    for (size_t i = 0; !batch->is_borrowed && i < batch->part_count; i++) {
        umbs_entry_release(batch->parts[i].entry);
    }
    umbd_picture_work_finish(&batch->picture_work);
    free(batch->message);
    free(batch->reply);
}

void umbd_batch_destroy(struct umbd_batch *batch)
{
    if (batch != NULL) {
        finish_batch(batch);
        free(batch);
    }
}

void umbd_batch_recycle(struct umbd_batch *batch, struct umbd_batch **spare)
{
    if (batch == NULL) {
        return;
    }
    finish_batch(batch);
    if (*spare == NULL && batch->part_limit == 1) {
        *spare = batch;
    } else {
        free(batch);
    }
}

/* Reads the clock that times so many points: the wall clock for a few, else the thread's CPU time.
 * Reading the CPU time is a system call of 0.7 us, longer than a few look-ups take. A thread switch
 * hardly ever falls into such a short time, so the wall clock is more accurate there. */
static uint64_t cost_clock_ns(size_t points)
{
    return points < CPU_CLOCK_POINTS ? umbu_clock_ns() : umbu_thread_cpu_ns();
}

/* A view of `count` points from `first` on. */
static struct umb_points sub_points(const struct umb_points *points, size_t first, size_t count)
{
    struct umb_points part = *points;
    if (count == 0) {
        part.count = 0; /* there may be no address to add to */
        return part;
    }
    size_t stride = 3 * (points->format == UMB_POINT_F64 ? sizeof(double) : sizeof(float));
    part.positions = (const uint8_t *)points->positions + first * stride;
    part.normals = NULL;
    part.footprints =
        points->footprints ? (const uint8_t *)points->footprints + first * sizeof(float) : NULL;
    part.count = count;
    return part;
}

/* Checks the footprints of pixels, with the same messages as umb_points_check. */
static enum umb_status check_pixels(const struct umbd_batch *batch, size_t first, size_t count,
                                    struct umb_error *error)
{
    const uint8_t *footprints = batch->points.footprints;
    for (size_t i = first; footprints != NULL && i < first + count; i++) {
        float side;
        memcpy(&side, footprints + i * sizeof side, sizeof side);
        if (!(side >= 0 && isfinite(side))) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "footprints[%zu]: %g, must be finite and not below 0", i, (double)side);
        }
    }
    return UMB_OK;
}

static enum umb_status check_points(const struct umbd_batch *batch, size_t first, size_t count,
                                    struct umb_error *error)
{
    if (batch->picture_work.has_picture) {
        return check_pixels(batch, first, count, error); /* pixel depths may have any value */
    }
    struct umb_points part = sub_points(&batch->points, first, count);
    if (umb_points_check(&part, error) == UMB_OK) {
        return UMB_OK;
    }
    /* Repeats the check, so that the message has indices of the whole batch. All points before
     * `first` are valid. */
    part = sub_points(&batch->points, 0, first + count);
    return umb_points_check(&part, error);
}

struct slice {
    const struct umbd_batch *batch;
    const struct umbd_part *part;
    size_t first, count;
    struct umb_answers *answers;
};

/* Runs one slice. The function owns nothing, because a fault in a cut file may end it midway. */
static void run_slice(void *user)
{
    const struct slice *slice = user;
    if (slice->batch->picture_work.has_picture) {
        umbd_picture_work_run(slice->batch, &slice->part->query, slice->first, slice->count,
                              slice->answers);
        return;
    }
    umb_query_run(&slice->part->query, &slice->batch->points, slice->first, slice->count,
                  slice->answers);
}

/* Checks and answers points first .. first + count - 1. In: result: zeroed, except for its error.
 * Fails: E_ARGUMENT, naming the index within the whole batch. */
static enum umb_status run(struct umbd_task *task, size_t first, size_t count,
                           struct umbd_slice_result *result)
{
    const struct umbd_batch *batch = umbd_batch_of(task);
    uint64_t from = batch->want_stats ? cost_clock_ns(count) : 0;
    enum umb_status status = check_points(batch, first, count, &result->error);
    for (size_t i = 0; status == UMB_OK && i < batch->part_count; i++) {
        struct umb_answers answers = {.values = batch->values + i * batch->part_bytes};
        struct slice slice = {batch, &batch->parts[i], first, count, &answers};
        struct umbs_entry *entry = batch->parts[i].entry;
        status = batch->is_optimistic
                     ? umbs_entry_read_optimistic(entry, run_slice, &slice, &result->error)
                     : umbs_entry_read(entry, run_slice, &slice, &result->error);
        umb_query_stats_add(&result->stats, &answers.stats);
    }
    result->cpu_ns = batch->want_stats ? cost_clock_ns(count) - from : 0;
    return status;
}

static enum umb_status end(struct umbd_task *task, struct umb_error *error)
{
    struct umbd_batch *batch = umbd_batch_of(task);
    return batch->picture_work.pack ? umbd_picture_work_pack(batch, error) : UMB_OK;
}

static void free_task(struct umbd_task *task)
{
    umbd_batch_destroy(umbd_batch_of(task));
}

enum umb_status umbd_batch_reserve(struct umbd_batch *batch, size_t head_room,
                                   struct umb_error *error)
{
    batch->reply = malloc(head_room + batch->value_bytes + 1);
    if (batch->reply == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for %zu bytes of answers",
                        batch->value_bytes);
    }
    batch->head_room = head_room;
    batch->values = batch->reply + head_room;
    batch->task.run = run;
    batch->task.end = end;
    batch->task.free = free_task;
    batch->task.items = "points";
    batch->task.count = batch->points.count;
    batch->task.slice = slice_points(batch);
    batch->task.answered = batch->points.count * batch->part_count;
    return UMB_OK;
}

void umbd_batch_run(struct umbd_batch *batch, struct umbd_metrics *metrics)
{
    struct umbd_slice_result result UMB__UNSET;
    struct umbd_task *task = &batch->task;
    memset(&result.stats, 0, sizeof result.stats);
    result.cpu_ns = 0;
    umbd_count(&metrics->batches_started, 1);
    task->status = run(task, 0, batch->points.count, &result);
    if (task->status != UMB_OK) {
        task->error = result.error;
        return;
    }
    task->stats = result.stats;
    task->cpu_ns = result.cpu_ns;
    umbd_count(&metrics->points, batch->points.count * batch->part_count);
}
