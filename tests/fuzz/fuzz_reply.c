/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Replies of a hostile server to libumbrage: headers and DATA of one call, cut anywhere, then the
 * decoders of job replies and region replies as the client calls them. The two client files are
 * part of this program, so that their call-backs can be fed without a socket.
 */
#include "rpc/region_daemon.c"
#include "rpc/rpc_jobs.c"

#include "fuzz.h"

#define PLACE_BYTES 4096

struct input {
    const uint8_t *at, *end;
};

static uint8_t next(struct input *input)
{
    return input->at < input->end ? *input->at++ : 0;
}

static const uint8_t *take(struct input *input, size_t want, size_t *got)
{
    const uint8_t *from = input->at;
    *got = (size_t)(input->end - from) < want ? (size_t)(input->end - from) : want;
    input->at += *got;
    return from;
}

/* ---- one reply ---- */

static void one_header(struct umb__reply *reply, struct input *input)
{
    static const char *const names[] = {":status",      "content-type",           "grpc-status",
                                        "grpc-message", "grpc-retry-pushback-ms", "other"};
    static const char *const values[] = {"200", "application/grpc", "0", "8", "100", "503"};
    struct umb_error error;
    const uint8_t pick = next(input);
    const char *name = names[pick % 6];
    size_t size;
    if (pick & 0x80) {
        const char *value = values[next(input) % 6];
        (void)!umb__reply_header(reply, (const uint8_t *)name, strlen(name), (const uint8_t *)value,
                                 strlen(value), &error);
    } else {
        const uint8_t *value = take(input, next(input), &size);
        (void)!umb__reply_header(reply, (const uint8_t *)name, strlen(name), value, size, &error);
    }
}

static bool count_message(void *user, const uint8_t *message, size_t size)
{
    size_t *left = user;
    for (size_t i = 0; i < size; i++) {
        *left += message[i] & 1U;
    }
    return size != 7;
}

/* A verdict of UMB_OK requires one message, headers of gRPC and a status of 0. */
static void one_reply(struct input *input)
{
    struct umb__reply reply;
    struct umb_error error = {0};
    const size_t most = 1 + 16 * (size_t)next(input);
    const uint8_t how = next(input);
    size_t sum = 0;
    umb__reply_init(&reply, most);
    if (how & 1) {
        reply.take = count_message;
        reply.take_user = &sum;
    }
    while (input->at < input->end) {
        const uint8_t what = next(input);
        size_t size;
        if (what < 100) {
            one_header(&reply, input);
        } else if (what < 250) {
            const uint8_t *bytes = take(input, what - 99U, &size);
            if (umb__reply_data(&reply, bytes, size, &error) != UMB_OK) {
                FUZZ_DEMAND(error.message[0] != '\0');
                umb__reply_finish(&reply); /* as in a session: the call ends without a verdict */
                return;
            }
        } else {
            umb__reply_restart(&reply);
        }
        FUZZ_DEMAND(reply.header_bytes <= UMB__HEADER_BYTES_MAX);
        FUZZ_DEMAND(reply.message_size <= most);
    }
    if (umb__reply_verdict(&reply, &error) == UMB_OK) {
        FUZZ_DEMAND(reply.is_grpc && reply.http_status == 200 && reply.grpc_status == 0);
        FUZZ_DEMAND(reply.take != NULL || reply.message != NULL);
    } else {
        FUZZ_DEMAND(error.message[0] != '\0');
    }
    umb__reply_finish(&reply);
}

/* ---- jobs ---- */

static int told_status(void *user, const struct umb_job_status *status)
{
    size_t *on_status = user;
    FUZZ_DEMAND(strlen(status->job) < sizeof status->job);
    FUZZ_DEMAND(strlen(status->cause) < sizeof status->cause);
    FUZZ_DEMAND(strlen(status->phase) < sizeof status->phase);
    *on_status += (status->plan != NULL ? strlen(status->plan) : 0) +
                  (status->notices != NULL ? strlen(status->notices) : 0);
    return 1;
}

static void job_replies(struct input *input)
{
    struct umb_error error = {.status = UMB_OK};
    size_t on_status = 0, count = 0;
    struct watch watch = {.on_status = told_status, .user = &on_status};
    struct umb_job_status status, *jobs = NULL;
    struct list list = {&jobs, &count};
    struct umb_job_status *to = &status;
    const size_t size = (size_t)(input->end - input->at);
    if (!take_status(&watch, input->at, size)) {
        FUZZ_DEMAND(watch.watch.error.status != UMB_OK);
    }
    (void)!decode_status(&to, input->at, size, &error);
    if (decode_list(&list, input->at, size, &error) == UMB_OK) {
        FUZZ_DEMAND(count <= UMBW_JOBS_MAX && jobs != NULL);
    }
    umb_free(jobs);
}

struct got {
    uint64_t at, size;
};

/* Pieces come in order and within the size. */
static enum umb_status got_piece(void *user, uint64_t offset, const void *data, size_t bytes,
                                 uint64_t size)
{
    struct got *got = user;
    FUZZ_DEMAND(offset == got->at && offset <= size && bytes <= size - offset);
    FUZZ_DEMAND(bytes == 0 || data != NULL);
    got->at += bytes;
    got->size = size;
    return bytes == 13 ? UMB_E_IO : UMB_OK;
}

static void fetch_pieces(struct input *input)
{
    struct got got = {0, 0};
    struct fetch fetch = {.on_bytes = got_piece, .user = &got};
    while (input->at < input->end) {
        size_t size;
        const uint8_t *message = take(input, next(input), &size);
        if (!take_piece(&fetch, message, size)) {
            FUZZ_DEMAND(fetch.status != UMB_OK && fetch.error.message[0] != '\0');
            break;
        }
        FUZZ_DEMAND(fetch.at == got.at && fetch.at <= fetch.size);
    }
}

/* ---- regions ---- */

/* A reply must be stored in the call's own place, and an answer by a second asset must be
 * noticed. */
static void region_replies(struct input *input)
{
    struct daemon_source source = {.asset = "city"};
    struct gathering gathering = {.source = &source};
    uint8_t first[UMB_ID_BYTES] = {0};
    bool known = false;
    while (input->at < input->end) {
        struct umb_error error;
        const size_t wanted = 16U * next(input) % PLACE_BYTES;
        uint8_t *place = malloc(wanted + 1);
        size_t size;
        FUZZ_DEMAND(place != NULL);
        struct gather_call call = {.gathering = &gathering, .place = place, .wanted = wanted};
        const uint8_t *message = take(input, next(input), &size);
        if (take_reply(&call, message, size, &error) == UMB_OK) {
            FUZZ_DEMAND(call.got <= wanted);
            FUZZ_DEMAND(!known || memcmp(first, source.id, sizeof first) == 0);
            memcpy(first, source.id, sizeof first);
            known = true;
        }
        free(place);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static void (*const kinds[])(struct input *) = {one_reply, job_replies, fetch_pieces,
                                                    region_replies};
    if (size == 0 || size > 65536) {
        return 0;
    }
    uint8_t *exact = malloc(size);
    if (exact != NULL) {
        memcpy(exact, data, size);
        struct input input = {exact + 1, exact + size};
        kinds[exact[0] % 4](&input);
    }
    free(exact);
    return 0;
}
