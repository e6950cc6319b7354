/* SPDX-License-Identifier: Apache-2.0 */
/* The importer's sandbox: what it denies, and that the tries would succeed outside of it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "bake/sandbox/doctor.h"
#include "bake/sandbox/doctor_acts.h"
#include "bake/sandbox/sandbox.h"

#define WORK_BYTES (4U << 20) /* from mmap, not from the heap there is */

static void every_forbidden_act_is_denied(void **state)
{
    (void)state;
    if (umbb_sandbox_exempt()) {
        skip();
    }
    for (unsigned i = 0; i < umbb_act_count; i++) {
        int verdict = umbb_doctor_try(i, 1);
        if (verdict != UMBB_ACT_REFUSED && verdict != UMBB_ACT_KILLED) {
            fail_msg("%s: verdict %d", umbb_acts[i].name, verdict);
        }
    }
}

/* Most are let through outside; those that need root, or that a container denies, may not be. */
static void the_tries_succeed_outside_the_sandbox(void **state)
{
    unsigned allowed = 0;
    (void)state;
    for (unsigned i = 0; i < umbb_act_count; i++) {
        int verdict = umbb_doctor_try(i, 0);
        assert_in_range(verdict, UMBB_ACT_ALLOWED, UMBB_ACT_REFUSED); /* no filter kills */
        allowed += verdict == UMBB_ACT_ALLOWED;
    }
    assert_true(allowed >= umbb_act_count / 2);
}

/* What the importer needs still works: memory, its two descriptors, its own end. */
static int work_inside(void)
{
    struct umbb_sandbox sandbox;
    if (umbb_sandbox_enter(&sandbox, NULL) != UMB_OK) {
        return 1;
    }
    char *memory = malloc(WORK_BYTES);
    if (memory == NULL) {
        return 2;
    }
    memset(memory, 1, WORK_BYTES);
    free(memory);
    return write(STDERR_FILENO, "", 0) == 0 ? 0 : 3;
}

static void an_importer_can_work_inside(void **state)
{
    int status = -1;
    (void)state;
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        _exit(work_inside());
    }
    assert_true(child > 0);
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(status, 0);
}

static void a_missing_filter_is_no_sandbox(void **state)
{
    const struct umbb_sandbox none = {.namespaces = 1, .landlock_abi = 6};
    const struct umbb_sandbox reduced = {.seccomp = 1, .landlock_abi = 6};
    (void)state;
    if (umbb_sandbox_exempt()) {
        skip();
    }
    assert_string_equal(umbb_sandbox_level(&none), "none");
    assert_string_equal(umbb_sandbox_level(&reduced), "reduced");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_forbidden_act_is_denied),
        cmocka_unit_test(the_tries_succeed_outside_the_sandbox),
        cmocka_unit_test(an_importer_can_work_inside),
        cmocka_unit_test(a_missing_filter_is_no_sandbox),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
