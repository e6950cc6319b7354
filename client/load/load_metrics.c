/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the daemon's admin port, see load_metrics.h. Each reading is an HTTP request of its own. */
#include "load/load_metrics.h"

#include <curl/curl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PAGE_BYTES ((size_t)1 << 20)
#define WAIT_S     2

/* Reads the value of the line "NAME VALUE", without labels. Returns false if there is none. */
static bool find_value(const char *text, const char *name, double *value)
{
    size_t length = strlen(name);
    for (const char *line = text; line != NULL && *line != '\0';) {
        if (strncmp(line, name, length) == 0 && line[length] == ' ') {
            char *end;
            *value = strtod(line + length + 1, &end);
            return end != line + length + 1;
        }
        line = strchr(line, '\n');
        line = line != NULL ? line + 1 : NULL;
    }
    return false;
}

/* Reads figures from Prometheus' text format. */
static enum umb_status read_figures(const char *text, struct umbc_server_figures *figures,
                                    struct umb_error *error)
{
    if (!find_value(text, "process_cpu_seconds_total", &figures->cpu_s) ||
        !find_value(text, "umbrage_queries_total", &figures->points)) {
        return umb_fail(error, UMB_E_PROTOCOL, "--admin: the reply has no metrics of umbraged");
    }
    (void)find_value(text, "process_resident_memory_bytes", &figures->rss);
    (void)find_value(text, "umbrage_shed_total", &figures->shed);
    (void)find_value(text, "umbrage_buffered_bytes", &figures->buffered);
    return UMB_OK;
}

/* A page that is being received. */
struct page {
    char *text; /* char[PAGE_BYTES] */
    size_t size;
};

/* Appends bytes; drops those for which the page has no room. */
static size_t take_bytes(char *bytes, size_t size, size_t count, void *user)
{
    struct page *page = user;
    const size_t room = PAGE_BYTES - 1 - page->size, all = size * count;
    memcpy(page->text + page->size, bytes, all < room ? all : room);
    page->size += all < room ? all : room;
    return all;
}

/* Fetches http://ADMIN/metrics. Returns false without an answer. */
static bool fetch(const char *admin, struct page *page)
{
    char url[300];
    CURL *easy = curl_easy_init();
    (void)snprintf(url, sizeof url, "http://%s/metrics", admin);
    const bool came = easy != NULL && curl_easy_setopt(easy, CURLOPT_URL, url) == CURLE_OK &&
                      curl_easy_setopt(easy, CURLOPT_PROTOCOLS_STR, "http") == CURLE_OK &&
                      curl_easy_setopt(easy, CURLOPT_NOPROXY, "*") == CURLE_OK &&
                      curl_easy_setopt(easy, CURLOPT_NOSIGNAL, 1L) == CURLE_OK &&
                      curl_easy_setopt(easy, CURLOPT_TIMEOUT, (long)WAIT_S) == CURLE_OK &&
                      curl_easy_setopt(easy, CURLOPT_WRITEFUNCTION, take_bytes) == CURLE_OK &&
                      curl_easy_setopt(easy, CURLOPT_WRITEDATA, page) == CURLE_OK &&
                      curl_easy_perform(easy) == CURLE_OK && page->size > 0;
    curl_easy_cleanup(easy);
    return came;
}

enum umb_status umbc_server_figures_get(const char *admin, struct umbc_server_figures *figures,
                                        struct umb_error *error)
{
    const char *colon = strrchr(admin, ':');
    memset(figures, 0, sizeof *figures);
    if (colon == NULL || colon == admin || strlen(admin) > 255) {
        return umb_fail(error, UMB_E_ARGUMENT, "--admin '%.100s' is not HOST:PORT", admin);
    }
    struct page page = {.text = calloc(1, PAGE_BYTES)}; /* ends with a NUL */
    if (page.text == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for the daemon's metrics");
    }
    const enum umb_status status =
        fetch(admin, &page)
            ? read_figures(page.text, figures, error)
            : umb_fail(error, UMB_E_UNAVAILABLE, "--admin %.100s: no answer", admin);
    free(page.text);
    return status;
}
