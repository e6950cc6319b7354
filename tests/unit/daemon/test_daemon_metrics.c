/* SPDX-License-Identifier: Apache-2.0 */
/* The Prometheus text: names, buckets that add up, no free labels. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "daemon/base/daemon_metrics.h"
#include "daemon/service/services.h"

/* Rows of the table. */
#define QUERY (&umbd_methods[0])
#define LIST  (&umbd_methods[3])

static char *render(struct umbd_metrics *metrics, const struct umbd_gauges *gauges)
{
    char *text = NULL;
    size_t size = 0;
    assert_int_equal(umbd_metrics_text(metrics, gauges, &text, &size), UMB_OK);
    assert_int_equal(strlen(text), size);
    return text;
}

static void metrics_text_counts_calls_by_code_and_time(void **state)
{
    static struct umbd_metrics metrics;
    struct umbd_gauges gauges = {.queue_depth = 3, .assets = {.healthy = 2}, .ready = 1};
    (void)state;
    metrics.methods = umbd_methods;
    for (int i = 0; i < 3; i++) {
        umbd_metrics_started(&metrics, QUERY);
    }
    umbd_metrics_handled(&metrics, QUERY, 0, 40000);
    umbd_metrics_handled(&metrics, QUERY, 0, 50000);
    umbd_metrics_handled(&metrics, QUERY, 3, 7000000000);
    umbd_metrics_handled(&metrics, LIST, 99, 1);
    umbd_observe(&metrics.queued, 100000);
    struct umbs_store_report report = {
        .loaded = 3, .failed = 2, .failed_machine = 1, .load_ms = 1250};
    umbd_metrics_scanned(&metrics, &report);
    for (int i = 0; i < 6; i++) {
        umbd_metrics_started(&metrics, LIST);
    }
    char *text = render(&metrics, &gauges);
    static const char *const lines[] = {
        "\numbrage_inflight 5\n",
        "\numbrage_queue_seconds_bucket{le=\"5e-05\"} 0\n",
        "\numbrage_queue_seconds_bucket{le=\"0.0001\"} 1\n",
        "\numbrage_queue_seconds_sum 0.000100000\n",
        "\numbrage_queue_seconds_count 1\n",
        "\numbrage_asset_errors_total{reason=\"damaged\"} 1\n",
        "\numbrage_asset_errors_total{reason=\"machine\"} 1\n",
        "\numbrage_asset_load_seconds_sum 1.250\n",
        "\numbrage_asset_load_seconds_count 5\n",
        "\ngrpc_server_started_total{grpc_service=\"umbrage.v1.Shadows\",grpc_method=\"Query\","
        "grpc_type=\"unary\"} 3\n",
        "\ngrpc_server_handled_total{grpc_service=\"umbrage.v1.Shadows\",grpc_method=\"Query\","
        "grpc_type=\"unary\",grpc_code=\"OK\"} 2\n",
        "grpc_code=\"INVALID_ARGUMENT\"} 1\n",
        "grpc_method=\"List\",grpc_type=\"unary\",grpc_code=\"UNKNOWN\"} 1\n",
        "grpc_method=\"Query\",le=\"5e-05\"} 2\n",
        "grpc_method=\"Query\",le=\"5\"} 2\n",
        "grpc_method=\"Query\",le=\"+Inf\"} 3\n",
        "\ngrpc_server_handling_seconds_count{grpc_service=\"umbrage.v1.Shadows\","
        "grpc_method=\"Query\"} 3\n",
        "\numbrage_queue_depth 3\n",
        "\numbrage_asset_loaded 2\n",
        "\numbrage_ready 1\n",
        "\numbrage_batches_started_total 0\n",
        "\numbrage_h2_abuse_total{kind=\"control\"} 0\n",
        "\numbrage_build_info{version=\"",
    };
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        if (strstr(text, lines[i]) == NULL) {
            fail_msg("no line like '%s'", lines[i]);
        }
    }
    free(text);
}

static void metrics_text_declares_each_family_once(void **state)
{
    static struct umbd_metrics metrics = {.methods = umbd_methods};
    struct umbd_gauges gauges = {0};
    (void)state;
    char *text = render(&metrics, &gauges);
    for (char *at = strstr(text, "# TYPE "); at != NULL; at = strstr(at + 1, "# TYPE ")) {
        char family[96];
        size_t length = strcspn(at + 7, " ");
        assert_true(length < sizeof family - 9);
        memcpy(family, at, 7 + length);
        family[7 + length] = ' ';
        family[8 + length] = '\0';
        assert_null(strstr(at + 1, family));
    }
    const char *resident = strstr(text, "\nprocess_resident_memory_bytes ");
    assert_non_null(resident);
    assert_true(strtoull(resident + 31, NULL, 10) > 100000);
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(metrics_text_counts_calls_by_code_and_time),
        cmocka_unit_test(metrics_text_declares_each_family_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
