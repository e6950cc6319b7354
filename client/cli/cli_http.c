/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Ranges by HTTP, see cli_http.h. Each range is a request; several requests are under way at a time
 * over connections that stay open, or over one connection if the server speaks HTTP/2. A server
 * that ignores ranges (200 instead of 206) is refused before it sends the whole file.
 */
#include "cli_http.h"

#include "cli/shared/cli_common.h"
#include "tool/clock.h"

#include <curl/curl.h>
#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    AT_ONCE = 16, /* requests under way, so that their round trips overlap */
    CONNECT_TIMEOUT_S = 15,
    STALL_S = 30,           /* seconds below a byte a second after which a request fails */
    SLOWEST_BYTES_S = 1024, /* bytes a second that a range must have after STALL_S */
    TOKEN_MAX = 4096,       /* characters of a token */
};

/* One request under way. */
struct fetch {
    CURL *easy;
    size_t index;
    uint64_t wanted;
    uint8_t *bytes;
    size_t size, capacity;
    bool whole_file; /* true: the server sends more than the range */
    char reason[CURL_ERROR_SIZE];
};

struct http {
    CURLM *multi;
    char *url;
    char token[TOKEN_MAX + 2]; /* Bearer token; empty: none */
    double stop_s;             /* Time of umbu_clock_s at which all requests end; 0: never */
    struct fetch fetches[AT_ONCE];
};

static size_t take_bytes(char *bytes, size_t size, size_t count, void *user)
{
    struct fetch *fetch = user;
    const size_t all = size * count;
    long code = 0;
    (void)curl_easy_getinfo(fetch->easy, CURLINFO_RESPONSE_CODE, &code);
    if (code != 206) {
        fetch->whole_file = code == 200;
        return 0; /* the body of an error may be endless */
    }
    if (all > fetch->wanted - fetch->size) {
        fetch->whole_file = true;
        return 0;
    }
    memcpy(fetch->bytes + fetch->size, bytes, all);
    fetch->size += all;
    return all;
}

static enum umb_status begin(struct http *http, struct fetch *fetch, size_t index,
                             const struct umb_range *range, struct umb_error *error)
{
    char text[64];
    if (range->length > fetch->capacity) {
        uint8_t *bytes = realloc(fetch->bytes, (size_t)range->length);
        if (!bytes) {
            return umb_fail(error, UMB_E_NO_MEMORY, "http: no memory for %" PRIu64 " bytes",
                            range->length);
        }
        fetch->bytes = bytes;
        fetch->capacity = (size_t)range->length;
    }
    fetch->index = index;
    fetch->wanted = range->length;
    fetch->size = 0;
    fetch->whole_file = false;
    (void)snprintf(text, sizeof text, "%" PRIu64 "-%" PRIu64, range->offset,
                   range->offset + range->length - 1);
    uint64_t timeout_s = STALL_S + range->length / SLOWEST_BYTES_S;
    if (http->stop_s > 0) {
        const double left_s = http->stop_s - umbu_clock_s();
        if (left_s <= 0) {
            return umb_fail(error, UMB_E_DEADLINE, "'%.200s': no answer within --timeout",
                            http->url);
        }
        timeout_s = left_s < (double)timeout_s ? (uint64_t)left_s + 1 : timeout_s;
    }
    if (curl_easy_setopt(fetch->easy, CURLOPT_RANGE, text) != CURLE_OK ||
        curl_easy_setopt(fetch->easy, CURLOPT_TIMEOUT,
                         timeout_s < LONG_MAX ? (long)timeout_s : LONG_MAX) != CURLE_OK ||
        curl_multi_add_handle(http->multi, fetch->easy) != CURLM_OK) {
        return umb_fail(error, UMB_E_NO_MEMORY, "http: out of memory");
    }
    return UMB_OK;
}

static enum umb_status refusal_status(long code)
{
    return code == 404   ? UMB_E_NO_INPUT
           : code == 401 ? UMB_E_UNAUTHENTICATED
           : code == 403 ? UMB_E_PERMISSION
           : code == 429 ? UMB_E_BUSY
                         : UMB_E_UNAVAILABLE;
}

static enum umb_status judge(const struct http *http, const struct fetch *fetch, CURLcode result,
                             struct umb_error *error)
{
    long code = 0;
    (void)curl_easy_getinfo(fetch->easy, CURLINFO_RESPONSE_CODE, &code);
    if (fetch->whole_file) {
        return umb_fail(error, UMB_E_UNSUPPORTED,
                        "'%.200s': the server does not serve ranges (%ld to a request of one); "
                        "download the file and give its path",
                        http->url, code);
    }
    /* A refusal may cut off its body, so an HTTP error counts even if the write failed. A redirect
     * is an error only if curl did not follow it. */
    const bool refused = code >= 400 && (result == CURLE_OK || result == CURLE_WRITE_ERROR);
    if (result != CURLE_OK && !refused) {
        return umb_fail(error, UMB_E_UNAVAILABLE, "'%.200s': %.200s", http->url,
                        fetch->reason[0] ? fetch->reason : curl_easy_strerror(result));
    }
    if (code != 206) {
        return umb_fail(error, refusal_status(code), "'%.200s': the server says %ld%s", http->url,
                        code, code == 401 ? "; give --token-file" : "");
    }
    return UMB_OK;
}

/* Waits until some requests have ended, and passes their bytes on. Out: free_fetch: true for each
 * ended request. */
static enum umb_status finish_some(struct http *http, size_t *under_way, bool *free_fetch,
                                   umb_range_fn got, void *got_user, struct umb_error *error)
{
    int running, left;
    enum umb_status status = UMB_OK;
    if (curl_multi_perform(http->multi, &running) != CURLM_OK ||
        curl_multi_poll(http->multi, NULL, 0, running > 0 ? 1000 : 0, NULL) != CURLM_OK) {
        return umb_fail(error, UMB_E_IO, "http: waiting for the server failed");
    }
    const CURLMsg *message;
    while (status == UMB_OK && (message = curl_multi_info_read(http->multi, &left)) != NULL) {
        if (message->msg != CURLMSG_DONE) {
            continue;
        }
        size_t i = 0;
        while (http->fetches[i].easy != message->easy_handle) {
            i++;
        }
        status = judge(http, &http->fetches[i], message->data.result, error);
        (void)curl_multi_remove_handle(http->multi, http->fetches[i].easy);
        free_fetch[i] = true;
        (*under_way)--;
        if (status == UMB_OK) {
            status = got(got_user, http->fetches[i].index, http->fetches[i].bytes,
                         http->fetches[i].size);
        }
    }
    return status;
}

static enum umb_status read_ranges(void *user, const struct umb_range *ranges, size_t count,
                                   umb_range_fn got, void *got_user, struct umb_error *error)
{
    struct http *http = user;
    bool free_fetch[AT_ONCE];
    size_t next = 0, under_way = 0;
    enum umb_status status = UMB_OK;
    memset(free_fetch, true, sizeof free_fetch);
    while (status == UMB_OK && (next < count || under_way > 0)) {
        for (size_t i = 0; i < AT_ONCE && next < count && status == UMB_OK; i++) {
            if (free_fetch[i]) {
                status = begin(http, &http->fetches[i], next, &ranges[next], error);
                free_fetch[i] = false;
                next++;
                under_way++;
            }
        }
        if (status == UMB_OK) {
            status = finish_some(http, &under_way, free_fetch, got, got_user, error);
        }
    }
    for (size_t i = 0; i < AT_ONCE; i++) {
        if (!free_fetch[i]) {
            (void)curl_multi_remove_handle(http->multi, http->fetches[i].easy);
        }
    }
    return status;
}

/* Reads the token of a file that holds nothing else but line ends. */
static enum umb_status read_token(const char *path, char token[TOKEN_MAX + 2],
                                  struct umb_error *error)
{
    FILE *file = fopen(path, "re");
    if (!file) {
        return umb_fail_errno(error, errno == ENOENT ? UMB_E_NO_INPUT : UMB_E_IO, errno,
                              "--token-file: '%.200s'", path);
    }
    size_t size = fread(token, 1, TOKEN_MAX + 1, file);
    const bool failed = ferror(file) != 0;
    (void)fclose(file);
    while (size > 0 && (token[size - 1] == '\n' || token[size - 1] == '\r')) {
        size--;
    }
    token[size] = '\0';
    for (size_t i = 0; i < size; i++) {
        if (token[i] <= ' ' || token[i] > '~') {
            size = 0;
        }
    }
    return !failed && size > 0 && size <= TOKEN_MAX
               ? UMB_OK
               : umb_fail(error, UMB_E_ARGUMENT,
                          "--token-file: '%.200s' must hold one token of 1 to %d characters", path,
                          TOKEN_MAX);
}

/* Sets token and certificates of a request. */
static bool identify(const struct http *http, const struct umb_client_options *identity, CURL *easy)
{
    const struct {
        CURLoption option;
        const char *value;
    } texts[] = {
        {CURLOPT_XOAUTH2_BEARER, http->token[0] != '\0' ? http->token : NULL},
        {CURLOPT_CAINFO, identity->ca_file},
        {CURLOPT_SSLCERT, identity->certificate_file},
        {CURLOPT_SSLKEY, identity->key_file},
    };
    bool ok = http->token[0] == '\0' ||
              curl_easy_setopt(easy, CURLOPT_HTTPAUTH, (long)CURLAUTH_BEARER) == CURLE_OK;
    for (size_t i = 0; i < sizeof texts / sizeof texts[0] && ok; i++) {
        ok = texts[i].value == NULL ||
             curl_easy_setopt(easy, texts[i].option, texts[i].value) == CURLE_OK;
    }
    return ok;
}

static bool prepare(const struct http *http, struct fetch *fetch)
{
    /* A redirect must not lead from TLS to plain HTTP. */
    const char *onward = strncmp(http->url, "https://", 8) == 0 ? "https" : "http,https";
    fetch->easy = curl_easy_init();
    return fetch->easy && curl_easy_setopt(fetch->easy, CURLOPT_URL, http->url) == CURLE_OK &&
           curl_easy_setopt(fetch->easy, CURLOPT_PROTOCOLS_STR, "http,https") == CURLE_OK &&
           curl_easy_setopt(fetch->easy, CURLOPT_WRITEFUNCTION, take_bytes) == CURLE_OK &&
           curl_easy_setopt(fetch->easy, CURLOPT_WRITEDATA, fetch) == CURLE_OK &&
           curl_easy_setopt(fetch->easy, CURLOPT_ERRORBUFFER, fetch->reason) == CURLE_OK &&
           curl_easy_setopt(fetch->easy, CURLOPT_FOLLOWLOCATION, 1L) == CURLE_OK &&
           curl_easy_setopt(fetch->easy, CURLOPT_REDIR_PROTOCOLS_STR, onward) == CURLE_OK &&
           curl_easy_setopt(fetch->easy, CURLOPT_MAXREDIRS, 5L) == CURLE_OK &&
           curl_easy_setopt(fetch->easy, CURLOPT_NOSIGNAL, 1L) == CURLE_OK &&
           curl_easy_setopt(fetch->easy, CURLOPT_CONNECTTIMEOUT, (long)CONNECT_TIMEOUT_S) ==
               CURLE_OK &&
           curl_easy_setopt(fetch->easy, CURLOPT_LOW_SPEED_LIMIT, 1L) == CURLE_OK &&
           curl_easy_setopt(fetch->easy, CURLOPT_LOW_SPEED_TIME, (long)STALL_S) == CURLE_OK;
}

enum umb_status umbc_http_open(const char *url, double stop_s,
                               const struct umb_client_options *identity,
                               struct umb_region_source *source, struct umb_error *error)
{
    *source = (struct umb_region_source){0};
    if (strncmp(url, "http://", 7) != 0 && strncmp(url, "https://", 8) != 0) {
        return umb_fail(error, UMB_E_ARGUMENT, "url: '%.200s', must begin with http:// or https://",
                        url);
    }
    struct http *http = calloc(1, sizeof *http);
    bool ok = http && curl_global_init(CURL_GLOBAL_DEFAULT) == CURLE_OK;
    if (ok) {
        *source = (struct umb_region_source){.read = read_ranges, .user = http};
        http->multi = curl_multi_init();
        http->url = strdup(url);
        http->stop_s = stop_s;
        ok = http->multi && http->url;
    }
    if (ok && identity->token_file) {
        const enum umb_status status = read_token(identity->token_file, http->token, error);
        if (status != UMB_OK) {
            umbc_http_close(source);
            return status;
        }
    }
    for (size_t i = 0; i < AT_ONCE && ok; i++) {
        ok = prepare(http, &http->fetches[i]) && identify(http, identity, http->fetches[i].easy);
    }
    if (!ok) {
        umbc_http_close(source);
        return umb_fail(error, UMB_E_NO_MEMORY, "http: out of memory");
    }
    return UMB_OK;
}

void umbc_http_close(struct umb_region_source *source)
{
    struct http *http = source->user;
    if (!http) {
        return;
    }
    for (size_t i = 0; i < AT_ONCE; i++) {
        curl_easy_cleanup(http->fetches[i].easy);
        free(http->fetches[i].bytes);
    }
    (void)curl_multi_cleanup(http->multi);
    free(http->url);
    free(http);
    curl_global_cleanup();
    source->user = NULL;
}
