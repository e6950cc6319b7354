/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage load: loads a daemon and measures it. */
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "load/load_print.h"
#include "tool/tool_try.h"

/* Draws the line of figures anew. */
static void show_moment(void *user, const struct umbc_load_moment *moment,
                        const struct umbc_load_result *so_far)
{
    const struct umbc_load_test *test = user;
    if (!test->live) {
        return;
    }
    (void)fprintf(
        stderr,
        "\r%s %5.1f s  %.4g calls/s  %.3g Mpoints/s  p50 %.3g  p99 %.3g ms  errors %" PRIu64,
        moment->at_s <= 0 ? "warm-up" : "       ", moment->at_s, moment->calls_s,
        1e-6 * moment->calls_s * (double)test->pool.batch, moment->p50_ms, moment->p99_ms,
        so_far->error_count);
    if (moment->server_cores > 0) {
        (void)fprintf(stderr, "  daemon %.2f cores", moment->server_cores);
    }
    (void)fputs("\033[K", stderr);
    (void)fflush(stderr);
}

static void show_step(void *user, const struct umbc_load_step *step)
{
    const struct umbc_load_test *test = user;
    if (!test->options.quiet) {
        (void)fprintf(stderr,
                      "%9.6g calls/s: %9.6g answered, p50 %.3g, p99 %.3g ms, %" PRIu64
                      " failed: %s\n",
                      step->rate, step->calls_s, step->p50_ms, step->p99_ms, step->failed,
                      step->kept ? "kept" : "not kept");
    }
}

/* Asks for the asset's description and makes the points. */
static enum umb_status prepare(struct umbc_load_test *test, struct umb_error *error)
{
    struct umb_client *client;
    struct umbu_session *session = &test->options.session;
    umbu_session_complete(session);
    UMB__TRY(umb_client_open(session->address, &session->options, &client, error));
    test->options.settings.address = session->address;
    test->options.settings.client = session->options;
    enum umb_status status =
        umb_client_describe(client, test->options.settings.asset, &test->about, NULL, error);
    if (status == UMB_OK && test->options.source.light >= test->about->light_count) {
        status = umb_fail(error, UMB_E_NOT_FOUND, "light: %u of %u lights",
                          (unsigned)test->options.source.light, (unsigned)test->about->light_count);
    }
    if (status == UMB_OK) {
        status = umbc_load_pool_make(&test->options.source, &test->about->bounds, client,
                                     &test->pool, error);
    }
    umb_client_close(client);
    return status;
}

static enum umb_status measure(struct umbc_load_test *test, struct umb_error *error)
{
    const struct umbc_load_options *options = &test->options;
    if (options->sweep) {
        const enum umb_status status =
            umbc_load_sweep_run(&options->settings, &test->pool, options->bound_ms, show_step, test,
                                &test->sweep, error);
        test->result = test->sweep.at_knee;
        return status;
    }
    test->live = !options->quiet && isatty(STDERR_FILENO) == 1;
    enum umb_status status =
        umbc_load_run(&options->settings, &test->pool, show_moment, test, &test->result, error);
    if (test->live) {
        (void)fputs("\r\033[K", stderr);
    }
    return status;
}

/* Runs the test and prints its result. */
static enum umb_status run(struct umbc_load_test *test, struct umb_error *error)
{
    const struct umbc_load_options *options = &test->options;
    UMB__TRY(prepare(test, error));
    if (options->report != NULL) { /* before the run: a page that cannot be written fails early */
        UMB__TRY(umbu_output_begin(options->report, UMBU_OUTPUT_COMMAND, &test->report, error));
    }
    UMB__TRY(measure(test, error));
    (options->json ? umbc_load_print_json : umbc_load_print_text)(stdout, test);
    if (options->report == NULL) {
        return UMB_OK;
    }
    umbc_load_print_page(test->report.file, test);
    return umbu_output_commit(&test->report, error);
}

int umbc_load(int argc, char **argv)
{
    struct umb_error error = {.status = UMB_OK};
    struct umbc_load_test *test = calloc(1, sizeof *test);
    if (test == NULL) {
        return umbc_complain_as(UMB_E_NO_MEMORY, "load: out of memory");
    }
    int code = umbc_load_options_parse(argc, argv, &test->options);
    if (code >= 0) {
        free(test);
        return code;
    }
    const enum umb_status status = run(test, &error);
    code = status == UMB_OK ? 0 : umbc_complain(&error);
    if (status == UMB_OK && test->options.sweep && test->sweep.knee <= 0) {
        code = UMBC_EXIT_NEGATIVE;
    }
    umbu_output_abandon(&test->report);
    umb_free(test->about);
    umbc_load_pool_finish(&test->pool);
    free(test);
    return umbc_finish_stdout(code);
}
