/* SPDX-License-Identifier: Apache-2.0 */
/* The snippet of docs/guide/embedding.md that queries a daemon, compiled and run; a test compares
 * the texts. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include "fake_server.h"
#include "umbrage/client.h"

static int report(const char *message)
{
    print_error("%s\n", message);
    return 1;
}

static int ask(const char *address, const float *positions, size_t count, float *visibility)
{
    /* snippet begins */
    struct umb_client *client;
    struct umb_error error;
    if (umb_client_open(address, NULL, &client, &error) != UMB_OK) {
        return report(error.message);
    }
    struct umb_client_query_request request = {.asset = "city",
                                               .settings = {.taps = 9},
                                               .points = {.positions = positions, .count = count}};
    enum umb_status status = umb_client_query(client, &request, visibility, NULL, &error);
    umb_client_close(client);
    return status == UMB_OK ? 0 : report(error.message);
    /* snippet ends */
}

static void client_snippet_answers(void **state)
{
    struct fake_server server = {.http1 = false};
    static const float positions[6] = {0.25F, 1, 2, 0.75F, 3, 4};
    float visibility[2] = {0, 0};
    char address[128];
    (void)state;
    fake_start(&server, 0, address);
    assert_int_equal(ask(address, positions, 2, visibility), 0);
    assert_true(visibility[0] == 0.25F && visibility[1] == 0.75F); /* it answers with x */
    fake_stop(&server);
    assert_int_equal(ask(address, positions, 2, visibility), 1); /* the server has gone */
    assert_int_equal(ask("nonsense", positions, 2, visibility), 1);
}

static void page_shows_the_client_snippet(void **state)
{
    (void)state;
    static char page[65536], source[16384];
    FILE *file = fopen("docs/guide/embedding.md", "r");
    if (!file) {
        skip(); /* not run from the top folder */
    }
    page[fread(page, 1, sizeof page - 1, file)] = '\0';
    (void)fclose(file);
    file = fopen("tests/unit/rpc/test_readme_client.c", "r");
    assert_non_null(file);
    source[fread(source, 1, sizeof source - 1, file)] = '\0';
    (void)fclose(file);
    char *line = strstr(source, "/* snippet begins */\n");
    char *end = strstr(source, "    /* snippet ends */");
    assert_true(line != NULL && end != NULL);
    for (line = strchr(line, '\n') + 1; line < end;) {
        char *next = strchr(line, '\n');
        *next = '\0';
        if (strstr(page, line + 4) == NULL) {
            fail_msg("not in docs/guide/embedding.md: %s", line + 4);
        }
        line = next + 1;
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(client_snippet_answers),
        cmocka_unit_test(page_shows_the_client_snippet),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
