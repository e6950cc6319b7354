/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_record_progress.h. */
#include "cli_record_progress.h"

#include <math.h>

void umbc_records_begin(struct umbc_record_progress *progress, const char *unit, bool quiet,
                        const struct umbc_points *source)
{
    *progress = (struct umbc_record_progress){.source = source};
    umbu_progress_begin(&progress->line, unit, quiet);
}

void umbc_records_batch(struct umbc_record_progress *progress, size_t count)
{
    progress->done += progress->count;
    progress->count = count;
}

/* Returns the answered share of all records. While the source is being read, the share is measured
 * by the source's bytes; once its last record was read, by records. */
static double share_done(const struct umbc_record_progress *progress, double answered)
{
    const struct umbc_points *source = progress->source;
    const double of_batch = progress->count > 0 ? answered / (double)progress->count : 1;
    if (source->ended) {
        const double all = (double)progress->done + (double)progress->count;
        return all > 0 ? ((double)progress->done + answered) / all : 1;
    }
    return source->size > 0
               ? ((double)progress->begin + (double)(source->offset - progress->begin) * of_batch) /
                     (double)source->size
               : -1;
}

void umbc_records_show(struct umbc_record_progress *progress, double answered)
{
    umbu_progress_show(&progress->line, (double)progress->done + answered,
                       share_done(progress, answered));
    if (answered >= (double)progress->count) {
        progress->begin = progress->source->offset;
    }
}

void umbc_records_end(struct umbc_record_progress *progress)
{
    umbu_progress_end(&progress->line);
}

#define SAMPLES 24 /* along each axis */

static double determinant(const double m[3][3])
{
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
           m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

/* Returns 1 if a point of the box lies in the frustum. In: the point's place in the box, 0..1 along
 * each axis. */
static int in_frustum(const struct umb_frustum_info *f, const double origin[3],
                      const struct umb_box *box, const double at[3])
{
    const double size = (double)((uint64_t)1 << f->log2_size);
    for (unsigned k = 0; k < 3; k++) {
        double voxel = f->world_to_voxel[k][3];
        for (unsigned axis = 0; axis < 3; axis++) {
            const double w = box->min[axis] + (box->max[axis] - box->min[axis]) * at[axis];
            voxel += f->world_to_voxel[k][axis] * (w - origin[axis]);
        }
        if (!(voxel >= 0 && voxel < size)) {
            return 0;
        }
    }
    return 1;
}

/* Cuts the box to the bounds of the frustum's corners, so that a good part of the box lies inside
 * the frustum. */
static struct umb_box cut_box(const struct umb_frustum_info *f, const double origin[3],
                              const struct umb_box *box)
{
    const double size = (double)((uint64_t)1 << f->log2_size);
    struct umb_box cut = *box;
    for (unsigned axis = 0; axis < 3; axis++) {
        double low = origin[axis], high = origin[axis];
        for (unsigned k = 0; k < 3; k++) {
            const double first = -f->world_to_voxel[k][3] * f->voxel_step[k][axis];
            const double last = first + size * f->voxel_step[k][axis];
            low += fmin(first, last);
            high += fmax(first, last);
        }
        cut.min[axis] = fmax(cut.min[axis], low);
        cut.max[axis] = fmax(cut.min[axis], fmin(cut.max[axis], high));
    }
    return cut;
}

double umbc_box_voxels(const struct umb_frustum_info *frustum, const double origin[3],
                       const struct umb_box *box)
{
    const struct umb_box cut = cut_box(frustum, origin, box);
    double voxels = 1 / fabs(determinant(frustum->voxel_step));
    unsigned hits = 0;
    for (unsigned axis = 0; axis < 3; axis++) {
        voxels *= cut.max[axis] - cut.min[axis];
    }
    for (unsigned i = 0; i < SAMPLES * SAMPLES * SAMPLES; i++) {
        const double at[3] = {(i % SAMPLES + 0.5) / SAMPLES,
                              (i / SAMPLES % SAMPLES + 0.5) / SAMPLES,
                              (i / (SAMPLES * SAMPLES) + 0.5) / SAMPLES};
        hits += (unsigned)in_frustum(frustum, origin, &cut, at);
    }
    return voxels * hits / (SAMPLES * SAMPLES * SAMPLES);
}
