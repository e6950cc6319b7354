/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures, see batch.h. */
#include <stdlib.h>
#include <string.h>

#include "base/try.h"
#include "daemon/work/batch.h"

#define CHUNK_PIXELS 512 /* their points stay in the nearest cache */

void umbd_kept_picture_drop(struct umbd_kept_picture *kept)
{
    free(kept->values);
    *kept = (struct umbd_kept_picture){0};
}

void umbd_picture_work_run(const struct umbd_batch *batch, const struct umb_query *query,
                           size_t first, size_t count, struct umb_answers *answers)
{
    const enum umb_answer_format format = batch->settings.format;
    struct umb_picture picture = batch->picture_work.picture;
    float positions[3 * CHUNK_PIXELS];
    uint8_t *values = answers->values;
    picture.depth = batch->points.positions;
    for (size_t done = 0; done < count; done += CHUNK_PIXELS) {
        const size_t at = first + done;
        const size_t left = count - done, pixels = left < CHUNK_PIXELS ? left : CHUNK_PIXELS;
        const uint8_t *normals = batch->points.normals;
        const uint8_t *footprints = batch->points.footprints;
        struct umb_points points = {.positions = positions,
                                    .format = UMB_POINT_F32,
                                    .normals = normals ? normals + 12 * at : NULL,
                                    .count = pixels,
                                    .footprints = footprints ? footprints + 4 * at : NULL};
        memcpy(points.origin, picture.camera.eye, sizeof points.origin);
        umb_picture_points(&picture, at, pixels, positions);
        answers->values = values + umb_answer_bytes(format, at);
        umb_query_run(query, &points, 0, pixels, answers);
    }
    answers->values = values;
    umb_picture_fill(&picture, first, count, format, values);
}

/* Packs the whole answers, and also the changes if there is a base, and keeps the shorter form. If
 * the whole picture moves, the whole form is shorter: each shadow border then appears twice among
 * the changes. */
static enum umb_status pack_shorter(struct umbd_batch *batch, uint8_t *scratch, uint8_t *other,
                                    struct umb_error *error)
{
    struct umbd_picture_work *picture_work = &batch->picture_work;
    uint8_t *packed = picture_work->block + batch->head_room;
    size_t changes = 0;
    UMB__TRY(umb_picture_pack(batch->values, NULL, batch->value_bytes, NULL, packed,
                              &picture_work->packed_bytes, error));
    if (other == NULL) {
        return UMB_OK;
    }
    UMB__TRY(umb_picture_pack(batch->values, picture_work->kept.values, batch->value_bytes, scratch,
                              other, &changes, error));
    if (changes < picture_work->packed_bytes) {
        memcpy(packed, other, changes);
        picture_work->packed_bytes = changes;
        picture_work->changes = 1;
    }
    return UMB_OK;
}

enum umb_status umbd_picture_work_pack(struct umbd_batch *batch, struct umb_error *error)
{
    struct umbd_picture_work *picture_work = &batch->picture_work;
    const size_t size = batch->value_bytes, room = umb_picture_room(size);
    const int has_base = picture_work->kept.values != NULL;
    uint8_t *scratch = malloc(size + 1);
    uint8_t *other = has_base ? malloc(room) : NULL;
    picture_work->block = malloc(batch->head_room + room);
    if (scratch == NULL || picture_work->block == NULL || (has_base && other == NULL)) {
        free(scratch);
        free(other);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory to pack a frame");
    }
    enum umb_status status = pack_shorter(batch, scratch, other, error);
    free(other);
    memcpy(scratch, batch->values, size);
    umbd_kept_picture_drop(&picture_work->kept);
    picture_work->kept = (struct umbd_kept_picture){scratch, size, umb_picture_mark(scratch, size)};
    return status;
}

void umbd_picture_work_finish(struct umbd_picture_work *picture_work)
{
    umbd_kept_picture_drop(&picture_work->kept);
    free(picture_work->block);
    picture_work->block = NULL;
}
