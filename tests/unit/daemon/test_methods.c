/* SPDX-License-Identifier: Apache-2.0 */
/* The table of methods: every row is whole, and its columns agree with each other. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>

#include "daemon/service/services.h"

static void every_row_has_a_path_of_its_own_and_a_function_that_serves(void **state)
{
    (void)state;
    for (const struct umbd_method *method = umbd_methods; method->path != NULL; method++) {
        const char *slash = strchr(method->path + 1, '/');
        assert_int_equal(method->path[0], '/');
        assert_true(slash != NULL && slash[1] != '\0' && strchr(slash + 1, '/') == NULL);
        assert_non_null(method->serve);
        for (const struct umbd_method *other = umbd_methods; other < method; other++) {
            assert_string_not_equal(other->path, method->path);
        }
    }
}

/* A stream must pay for each request: if it paid only when it began, it could query any number of
 * points at one price. */
static void streams_of_requests_pay_for_each_request(void **state)
{
    (void)state;
    for (const struct umbd_method *method = umbd_methods; method->path != NULL; method++) {
        if (umbd_takes_many(method)) {
            assert_int_equal(method->price, UMBD_PRICE_REQUEST);
        }
        assert_true(umbd_takes_many(method) || method->end == NULL);
        assert_true((method->traits & UMBD_UPLOAD) == 0 || umbd_takes_many(method));
        assert_true((method->traits & UMBD_ENDLESS) == 0 || umbd_gives_many(method));
    }
}

/* Calls without rights are held in memory before anything is known of their callers, so their limit
 * is small. */
static void methods_without_rights_take_small_requests_only(void **state)
{
    (void)state;
    for (const struct umbd_method *method = umbd_methods; method->path != NULL; method++) {
        if (method->scope == UMBD_SCOPE_NONE) {
            assert_in_range(method->most_bytes, 256, 4096);
            assert_false(umbd_takes_many(method));
            assert_non_null(strstr(method->path, "grpc.health"));
        }
    }
}

static void the_last_row_stands_for_unknown_paths_and_does_nothing(void **state)
{
    size_t count = 0;
    (void)state;
    while (umbd_methods[count].path != NULL) {
        count++;
    }
    static const struct umbd_method unknown;
    assert_memory_equal(&umbd_methods[count], &unknown, sizeof unknown);
    assert_in_range(count, 1, UMBD_METHODS_MAX - 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_row_has_a_path_of_its_own_and_a_function_that_serves),
        cmocka_unit_test(streams_of_requests_pay_for_each_request),
        cmocka_unit_test(methods_without_rights_take_small_requests_only),
        cmocka_unit_test(the_last_row_stands_for_unknown_paths_and_does_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
