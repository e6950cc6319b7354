/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TESTS_FAKE_ANSWERS_H
#define UMBRAGE_TESTS_FAKE_ANSWERS_H
/*
 * What the server of fake_server.h answers to each method. The name of the asset in a query selects
 * the answer.
 *
 * Names: ok not-found reset refuse refuse-once goaway-once silent garbage over-long http-503 html
 * no-status no-message two-messages short compressed drop drop-inside bomb status-999 shed too-many
 * never-again away away-twice away-a-while away-for-good drop-once shed-once. "ok" answers each
 * point with its x coordinate (float).
 */
#include <math.h>

#include "fake_reply.h"
#include "wire/bakes.h"
#include "grpc/grpc.h"
#include "wire/messages.h"
#include "wire/regions.h"
#include "wire/versions.h"
#include "wire/volume_queries.h"

static void fake_answer(struct fake_stream *stream, const struct umbw_query_request *request,
                        size_t count)
{
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umbw_query_reply reply = {.has_stats = request->want_stats, .nanoseconds = 42};
    float *values = calloc(count + 1, sizeof *values);
    if (values == NULL) {
        abort();
    }
    for (size_t i = 0; i < count && request->points.format == UMB_POINT_F32; i++) {
        memcpy(&values[i], (const uint8_t *)request->points.positions + 12 * i, 4);
    }
    reply.visibility_bytes = count * sizeof *values;
    reply.stats.points = count;
    memset(reply.asset_id, 0xab, sizeof reply.asset_id);
    if (umbw_buffer_reserve(&buffer, umbw_query_reply_room(&reply), NULL) != UMB_OK) {
        abort();
    }
    buffer.size = umbw_write_query_reply_head(&reply, buffer.bytes);
    fake_append_buffer(stream, &buffer);
    fake_append(stream, values, reply.visibility_bytes);
    free(values);
}

static void fake_bomb(struct fake_connection *connection, int32_t id)
{
    static char value[4000];
    nghttp2_nv headers[40];
    memset(value, 'a', sizeof value - 1);
    headers[0] = fake_header(":status", "200");
    for (size_t i = 1; i < 40; i++) {
        headers[i] = fake_header("x-bomb", value);
    }
    (void)nghttp2_submit_response(connection->session, id, headers, 40, NULL);
}

static void fake_query(struct fake_connection *connection, struct fake_stream *stream,
                       const struct umbw_query_request *request)
{
    static const uint8_t garbage[] = {0, 0, 0, 0, 3, 0xff, 0xff, 0xff};
    static const uint8_t over_long[] = {0, 0x7f, 0xff, 0xff, 0xff, 1, 2, 3};
    const char *name = request->asset;
    const char *type = "application/grpc+proto";
    unsigned number = atomic_load(&connection->server->requests);
    bool first = number == 1;
    if (first && strcmp(name, "drop-once") == 0) {
        name = "drop";
    } else if (first && strcmp(name, "shed-once") == 0) {
        name = "shed";
    } else if (number <= 2 && strcmp(name, "away-twice") == 0) {
        name = "away";
    }
    if (strcmp(name, "away") == 0) {
        fake_trailers_only(connection, stream->id, "14", "draining");
    } else if (strcmp(name, "not-found") == 0) {
        fake_trailers_only(connection, stream->id, "5",
                           "asset: no %22not-found%22%0A caf%C3%A9 50%25");
    } else if (strcmp(name, "status-999") == 0) {
        fake_trailers_only(connection, stream->id, "9x9", "");
    } else if (strcmp(name, "shed") == 0) {
        fake_hint(connection, stream->id, "8", "50");
    } else if (strcmp(name, "never-again") == 0) {
        fake_hint(connection, stream->id, "8", "-1");
    } else if (strcmp(name, "away-for-good") == 0) {
        fake_hint(connection, stream->id, "14", "-1");
    } else if (strcmp(name, "away-a-while") == 0 && first) {
        fake_hint(connection, stream->id, "14", "400");
    } else if (strcmp(name, "too-many") == 0) {
        fake_trailers_only(connection, stream->id, "8", "points: 100 is over the limit of 1");
    } else if (strcmp(name, "reset") == 0) {
        (void)nghttp2_submit_rst_stream(connection->session, 0, stream->id, NGHTTP2_INTERNAL_ERROR);
    } else if (strcmp(name, "refuse") == 0 || (strcmp(name, "refuse-once") == 0 && first)) {
        (void)nghttp2_submit_rst_stream(connection->session, 0, stream->id, NGHTTP2_REFUSED_STREAM);
    } else if (strcmp(name, "goaway-once") == 0 && first) {
        (void)nghttp2_submit_goaway(connection->session, 0, 0, NGHTTP2_NO_ERROR, NULL, 0);
    } else if (strcmp(name, "silent") == 0) {
        return;
    } else if (strcmp(name, "http-503") == 0) {
        fake_append(stream, "<html>busy</html>", 17);
        stream->without_status = true;
        fake_send_reply(connection, stream, "503", "text/html");
    } else if (strcmp(name, "html") == 0) {
        fake_append(stream, "<html>hi</html>", 15);
        stream->without_status = true;
        fake_send_reply(connection, stream, "200", "text/html");
    } else if (strcmp(name, "garbage") == 0) {
        fake_append(stream, garbage, sizeof garbage);
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "over-long") == 0) {
        fake_append(stream, over_long, sizeof over_long);
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "compressed") == 0) {
        fake_answer(stream, request, request->points.count);
        stream->reply[0] = 1;
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "no-status") == 0) {
        fake_answer(stream, request, request->points.count);
        stream->without_status = true;
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "two-messages") == 0) {
        fake_answer(stream, request, request->points.count);
        fake_answer(stream, request, request->points.count);
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "no-message") == 0) {
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "drop-inside") == 0) {
        fake_answer(stream, request, request->points.count);
        stream->reply_size -= 1;
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "short") == 0) {
        fake_answer(stream, request, request->points.count - 1);
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "drop") == 0) {
        fake_answer(stream, request, request->points.count);
        stream->reply_size /= 2;
        stream->drop_after = 0;
        fake_send_reply(connection, stream, "200", type);
    } else if (strcmp(name, "bomb") == 0) {
        fake_bomb(connection, stream->id);
    } else {
        fake_answer(stream, request, request->points.count);
        fake_send_reply(connection, stream, "200", type);
    }
}

static void fake_list(struct fake_stream *stream)
{
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umb_client_asset assets[2] = {{.name = "a", .light_count = 1}, {.name = "b"}};
    struct umbw_list_reply reply = {.count = 2, .assets = assets};
    if (umbw_encode_list_reply(&reply, &buffer, NULL) != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
}

static void fake_describe(struct fake_stream *stream)
{
    char plan[] = "effect=closed state=on\n";
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umb_client_light light = {.info = {.name = "sun"}, .resolution = 1024, .closed = 1};
    struct umb_client_description reply = {
        .asset = {.name = "a"}, .light_count = 1, .lights = &light, .plan = plan};
    if (umbw_encode_describe_reply(&reply, &buffer, NULL) != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
}

/* Every limit has a value of its own. */
static void fake_limits(struct fake_stream *stream)
{
    struct umbw_buffer buffer = {NULL, 0, 0};
    const struct umbw_limits limits = {.client = {.max_points = 1001,
                                                  .max_message_bytes = (uint64_t)1002 << 32,
                                                  .max_targets = 1003,
                                                  .max_taps = 1004,
                                                  .version = "1.2.3-fake",
                                                  .max_segments = 1010,
                                                  .max_columns = 1011,
                                                  .max_boxes = 1012,
                                                  .max_box_steps = (uint64_t)1013 << 32},
                                       .max_streams = 1005,
                                       .queue = 1006,
                                       .max_bundle_bytes = 1007,
                                       .max_bundle_files = 1008,
                                       .max_owner_jobs = 1009};
    if (umbw_encode_limits_reply(&limits, &buffer, NULL) != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
}

static void fake_health(struct fake_stream *stream)
{
    const int serving = 1;
    struct umbw_buffer buffer = {NULL, 0, 0};
    if (umbw_encode_health_reply(&serving, &buffer, NULL) != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
}

/* Answers segments: `lit` of segment i is i, in i intervals, each of which begins at its number.
 * "lies" sends one interval less than it counts, "few" answers one segment less. Other volume
 * queries get an empty reply. Returns false for "silent", which gets no reply. */
static bool fake_segments(struct fake_stream *stream)
{
    struct umbw_volume_query_request request;
    struct umbw_buffer buffer = {NULL, 0, 0};
    double lit[16], intervals[16 * 16][2];
    uint32_t counts[16];
    size_t told = 0;
    if (umbw_decode_volume_query_request(UMBW_SEGMENTS, stream->body + 5, stream->body_size - 5,
                                         1000, &request, NULL) != UMB_OK) {
        return true; /* an empty reply */
    }
    if (strcmp(request.asset, "silent") == 0) {
        return false;
    }
    for (uint32_t i = 0; i < request.count && i < 16; i++) {
        lit[i] = counts[i] = i;
        for (uint32_t k = 0; k < i && k < request.max_intervals; k++, told++) {
            intervals[told][0] = k;
            intervals[told][1] = k + 0.5;
        }
    }
    const struct umbw_volume_query_reply reply = {
        .volume_query = UMBW_SEGMENTS,
        .asset_id = {0xab},
        .has_stats = request.want_stats,
        .nodes = 7,
        .count = request.count - (strcmp(request.asset, "few") == 0),
        .fields = {(const void *)lit, (const void *)lit, (const void *)counts,
                   (const void *)intervals},
        .interval_count = told - (strcmp(request.asset, "lies") == 0)};
    if (umbw_encode_volume_query_reply(&reply, &buffer, NULL) != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
    return true;
}

/* Answers samples: points made from the request's count and seed. "few" sends a point less and a
 * note, "lies" a point more, "far" one that is infinitely far away. Returns false for "silent",
 * which gets no answer. */
static bool fake_sample(struct fake_stream *stream)
{
    struct umbw_sample_request request;
    struct umbw_buffer buffer = {NULL, 0, 0};
    double positions[3 * 16];
    if (umbw_decode_sample_request(stream->body + 5, stream->body_size - 5, &request, NULL) !=
            UMB_OK ||
        request.settings.count > 8) {
        return true; /* an empty reply */
    }
    struct umbw_sample_reply reply = {
        .sample = {.count = request.settings.count, .origin = {1, 2, 3}, .asset_id = {0xab}},
        .points = (const uint8_t *)positions};
    for (size_t i = 0; i < sizeof positions / sizeof *positions; i++) {
        positions[i] = (double)(i + request.settings.seed);
    }
    if (strcmp(request.asset, "few") == 0) {
        reply.sample.count--;
        memcpy(reply.sample.note, "one is missing", 15);
    } else if (strcmp(request.asset, "lies") == 0) {
        reply.sample.count++;
    } else if (strcmp(request.asset, "far") == 0) {
        positions[3 * reply.sample.count - 1] = HUGE_VAL;
    }
    if (umbw_encode_sample_reply(&reply, &buffer, NULL) != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
    return strcmp(request.asset, "silent") != 0;
}

/* Answers calls about jobs: a job is done after one status in between, except one of "silent". An
 * asset is "0123456789" in two pieces. Returns false if nothing is answered. */
static bool fake_jobs(struct fake_stream *stream)
{
    struct umbw_buffer buffer = {NULL, 0, 0};
    struct umb_job_status jobs[2] = {{.job = "first", .state = 1}, {.job = "second", .state = 2}};
    const struct umbw_job_list list = {.jobs = jobs, .count = 2};
    const struct umb_job_submitted submitted = {.job = "first", .existing = 1};
    char job[UMBW_JOB_MAX + 1] = "";
    enum umb_status status = UMB_OK;
    (void)!umbw_decode_job_request(stream->body + 5, stream->body_size - 5, job, NULL);
    if (strcmp(job, "silent") == 0) {
        return false;
    }
    if (strcmp(stream->path, UMBW_PATH_BAKES_LIST) == 0) {
        status = umbw_encode_job_list(&list, &buffer, NULL);
    } else if (strcmp(stream->path, UMBW_PATH_BAKES_SUBMIT) == 0) {
        status = umbw_encode_submit_reply(&submitted, &buffer, NULL);
    } else if (strcmp(stream->path, UMBW_PATH_BAKES_DELETE) == 0) {
        status = umbw_encode_empty(&buffer, NULL);
    } else if (strcmp(stream->path, UMBW_PATH_BAKES_CANCEL) == 0) {
        status = umbw_encode_job_status(&jobs[1], &buffer, NULL);
    } else {
        for (size_t i = 0; i < 2 && status == UMB_OK; i++) {
            const struct umbw_fetch_reply piece = {
                .size = 10, .offset = 5 * i, .data = (const uint8_t *)"0123456789" + 5 * i, 5};
            status = strcmp(stream->path, UMBW_PATH_BAKES_FETCH) == 0
                         ? umbw_encode_fetch_reply(&piece, &buffer, NULL)
                         : umbw_encode_job_status(&jobs[i], &buffer, NULL);
        }
    }
    if (status != UMB_OK) {
        abort();
    }
    fake_append_buffer(stream, &buffer);
    return true;
}

/* Names two versions of an asset, 1 and 2, and ends; "lies" sends garbage after the first. Returns
 * false for "silent", which gets no answer. */
static bool fake_versions(struct fake_stream *stream)
{
    static const uint8_t garbage[] = {0, 0, 0, 0, 3, 0xff, 0xff, 0xff};
    struct umbw_version_request request;
    if (umbw_decode_version_request(stream->body + 5, stream->body_size - 5, &request, NULL) !=
        UMB_OK) {
        return true; /* an empty reply */
    }
    for (uint8_t i = 1; i <= 2; i++) {
        struct umbw_buffer buffer = {NULL, 0, 0};
        const struct umbw_region_reply reply = {.asset_id = {i}, .file_bytes = 100U * i};
        if (i == 2 && strcmp(request.asset, "lies") == 0) {
            fake_append(stream, garbage, sizeof garbage);
            break;
        }
        if (umbw_encode_region_reply(&reply, &buffer, NULL) != UMB_OK) {
            abort();
        }
        fake_append_buffer(stream, &buffer);
    }
    return strcmp(request.asset, "silent") != 0;
}

static void fake_respond(struct fake_connection *connection, struct fake_stream *stream)
{
    struct umbw_query_request request;
    int64_t nanoseconds;
    if (stream->body_size < UMBW_PREFIX_BYTES ||
        umbw_timeout_parse(stream->timeout, strlen(stream->timeout), &nanoseconds) != UMB_OK) {
        fake_trailers_only(connection, stream->id, "13", "no prefix or no timeout");
    } else if (strcmp(stream->path, UMBW_PATH_QUERY) == 0) {
        if (umbw_decode_query_request(stream->body + 5, stream->body_size - 5, SIZE_MAX, &request,
                                      NULL) == UMB_OK) {
            fake_query(connection, stream, &request);
        } else {
            fake_trailers_only(connection, stream->id, "3", "cannot decode");
        }
    } else {
        if (strcmp(stream->path, UMBW_PATH_LIST) == 0) {
            fake_list(stream);
        } else if (strcmp(stream->path, UMBW_PATH_DESCRIBE) == 0) {
            fake_describe(stream);
        } else if (strcmp(stream->path, UMBW_PATH_LIMITS) == 0) {
            fake_limits(stream);
        } else if (strcmp(stream->path, UMBW_PATH_SAMPLE) == 0) {
            if (!fake_sample(stream)) {
                return;
            }
        } else if (strncmp(stream->path, "/umbrage.v1.Bakes/", 18) == 0) {
            if (!fake_jobs(stream)) {
                return;
            }
        } else if (strcmp(stream->path, UMBW_PATH_REGIONS_WATCH) == 0) {
            if (!fake_versions(stream)) {
                return;
            }
        } else if (strncmp(stream->path, "/umbrage.v1.Questions/", 22) == 0) {
            if (!fake_segments(stream)) {
                return;
            }
        } else {
            fake_health(stream);
        }
        fake_send_reply(connection, stream, "200", "application/grpc");
    }
}

/* Answers the requests of a QueryStream that have arrived. "silent" and all later requests get no
 * answer, "not-found" ends the stream, "away" ends it as a server that shuts down, "drop" the
 * connection. */
static void fake_stream_respond(struct fake_connection *connection, struct fake_stream *stream)
{
    struct umbw_query_request request;
    while (stream->end == NULL && !connection->hang_up && stream->body_size - stream->taken >= 5) {
        const uint8_t *at = stream->body + stream->taken;
        size_t size = (size_t)at[3] << 8 | (size_t)at[4] | (size_t)at[2] << 16;
        if (stream->body_size - stream->taken - 5 < size) {
            break;
        }
        if (umbw_decode_query_request(at + 5, size, SIZE_MAX, &request, NULL) != UMB_OK) {
            abort();
        }
        atomic_fetch_add(&connection->server->streamed, 1);
        if (strcmp(request.asset, "silent") == 0) {
            return;
        }
        stream->taken += 5 + size;
        if (strcmp(request.asset, "drop") == 0) {
            connection->hang_up = true;
        } else if (strcmp(request.asset, "not-found") == 0) {
            stream->end = "5";
        } else if (strcmp(request.asset, "away") == 0) {
            stream->end = "14";
        } else {
            fake_answer(stream, &request, request.points.count);
        }
    }
    if (!stream->answering) {
        stream->answering = true;
        fake_send_reply(connection, stream, "200", "application/grpc");
    } else {
        (void)nghttp2_session_resume_data(connection->session, stream->id);
    }
}

#endif
