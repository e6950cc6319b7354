/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_WORK_VOLUME_QUERY_WORK_H
#define UMBRAGE_SERVER_DAEMON_WORK_VOLUME_QUERY_WORK_H
/*
 * Segments, columns and boxes of one request, answered by workers in slices. volume_query_work.c
 * does the work of a slice; service/service_volume_queries.c submits the task and sends the reply.
 */
#include "daemon/work/task.h"
#include "store/store.h"
#include "umbrage/volume.h"
#include "wire/volume_queries.h"

/* Most steps of a box; one with more fails (umbrage/volume.h). That many steps take most of a
 * second: a brick that the box's sides cut takes 64 steps and 1 to 3 us. A slice with such a box
 * occupies a worker for that time. */
#define UMBD_BOX_STEPS_MAX (1U << 24)

struct umbd_volume_query {
    struct umbd_task task;                    /* The first field */
    struct umbw_volume_query_request request; /* Request; its records lie in `message` */
    uint8_t *message;                         /* Message, owned */
    struct umbs_entry *entry;                 /* Version that answers, owned */
    struct umb_volume volume;
    uint8_t *answers; /* All answers, owned */
    /* Arrays of a reply. Here each segment has room for as many intervals as the request allows. */
    uint8_t *fields[UMBW_ANSWER_FIELDS];
    struct umbw_buffer reply; /* Reply with its prefix, owned */
};

/* The records in the library's form. */
struct umb_segments umbd_volume_query_pairs(const struct umbw_volume_query_request *request);

/* Answers a slice; it is the `run` of a task. Fails: E_ARGUMENT (a number that is not finite),
 * E_TOO_LARGE (a box with too many steps), E_DEADLINE, E_CANCELLED; as umbs_entry_read. */
UMB_CHECKED enum umb_status umbd_volume_query_run(struct umbd_task *task, size_t first,
                                                  size_t count, struct umbd_slice_result *result);

/* Makes the reply of all answers, once; it is the `end` of a task. Fails: E_NO_MEMORY,
 * E_TOO_LARGE. */
UMB_CHECKED enum umb_status umbd_volume_query_end(struct umbd_task *task, struct umb_error *error);

/*
 * Returns the approximate number of bricks that the sides of a box cut: its price, before its
 * voxels are counted. A large box spends nearly all its time in these bricks. The result is at most
 * the number of bricks on the six sides of the light's whole frustum.
 *
 * A plane with unit normal n cuts, for each unit of its area, the sum over the three axes of |n .
 * axis| times the brick's edge along that axis, divided by the brick's volume. Voxels may be much
 * longer across the light than along it. A convex body's surface meets each row of bricks twice.
 *
 * In:    box: min, max: any numbers; a value that is not finite counts as the whole frustum.
 */
double umbd_box_bricks(const struct umb_frustum_info *frustum, const struct umb_box *box);

#endif
