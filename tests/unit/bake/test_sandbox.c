/* SPDX-License-Identifier: Apache-2.0 */
/* The sandboxes of importer and bake: each forbidden act must fail inside, and succeed outside. */
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
#include "bake/sandbox/sandbox.h"

#define WORK_BYTES (4U << 20) /* from mmap, not from the heap there is */

/* Fails with the name of the first forbidden act that the sandbox of a place lets through. */
static void demand_denial(const struct umbb_act *acts, size_t count, unsigned place,
                          enum umbb_cage cage, const struct umbb_ground *ground, unsigned least)
{
    unsigned tried = 0;
    if (umbb_sandbox_exempt()) {
        skip();
    }
    for (size_t i = 0; i < count; i++) {
        if ((acts[i].places & place) == 0) {
            continue;
        }
        const int verdict = umbb_doctor_try(&acts[i], cage, ground);
        if (verdict != UMBB_ACT_REFUSED && verdict != UMBB_ACT_KILLED) {
            fail_msg("%s: verdict %d", acts[i].name, verdict);
        }
        tried++;
    }
    assert_true(tried >= least);
}

static void every_forbidden_act_is_denied(void **state)
{
    (void)state;
    demand_denial(umbb_acts, umbb_act_count, UMBB_IN_IMPORTER, UMBB_CAGE_IMPORTER, NULL, 30);
}

/* Without the filter, which would refuse first. */
static void landlock_denies_by_itself(void **state)
{
    (void)state;
    demand_denial(umbb_acts, umbb_act_count, UMBB_IN_LANDLOCK, UMBB_CAGE_LANDLOCK, NULL, 3);
}

static int make_ground(void **state)
{
    static struct umbb_ground ground;
    struct umb_error error;
    *state = &ground;
    return umbb_ground_make(&ground, &error) == UMB_OK ? 0 : -1;
}

static int remove_ground(void **state)
{
    umbb_ground_remove(*state);
    return 0;
}

static void a_bake_cannot_touch_what_is_not_its_own(void **state)
{
    demand_denial(umbb_bake_acts, umbb_bake_act_count, UMBB_IN_BAKE, UMBB_CAGE_BAKE, *state, 20);
    demand_denial(umbb_acts, umbb_act_count, UMBB_IN_BAKE, UMBB_CAGE_BAKE, *state, 20);
}

static void the_bakes_landlock_denies_by_itself(void **state)
{
    demand_denial(umbb_bake_acts, umbb_bake_act_count, UMBB_IN_BAKE_PATHS, UMBB_CAGE_BAKE_PATHS,
                  *state, 15);
}

static void a_bake_can_work_inside(void **state)
{
    for (size_t i = 0; i < umbb_bake_need_count; i++) {
        const int verdict = umbb_doctor_try(&umbb_bake_needs[i], UMBB_CAGE_BAKE, *state);
        if (verdict != UMBB_ACT_ALLOWED) {
            fail_msg("%s: verdict %d", umbb_bake_needs[i].name, verdict);
        }
    }
}

/* Most acts succeed outside; those that need root, or that a container denies, may fail. */
static void the_tries_succeed_outside_the_sandbox(void **state)
{
    unsigned allowed = 0;
    (void)state;
    for (unsigned i = 0; i < umbb_act_count; i++) {
        int verdict = umbb_doctor_try(&umbb_acts[i], UMBB_CAGE_NONE, NULL);
        assert_in_range(verdict, UMBB_ACT_ALLOWED, UMBB_ACT_FAILED);
        assert_int_not_equal(verdict, UMBB_ACT_KILLED); /* there is no filter */
        allowed += verdict != UMBB_ACT_REFUSED;
    }
    assert_true(allowed >= umbb_act_count / 2);
}

/* All acts on paths must succeed, since the paths belong to this process. Each act changes the
 * folder, so each gets a new one. */
static void the_bakes_tries_succeed_outside(void **state)
{
    for (size_t i = 0; i < umbb_bake_act_count; i++) {
        umbb_ground_remove(*state);
        assert_int_equal(make_ground(state), 0);
        const int verdict = umbb_doctor_try(&umbb_bake_acts[i], UMBB_CAGE_NONE, *state);
        if ((umbb_bake_acts[i].places & UMBB_IN_BAKE_PATHS) != 0 && verdict != UMBB_ACT_ALLOWED) {
            fail_msg("%s: verdict %d", umbb_bake_acts[i].name, verdict);
        }
    }
}

/* What the importer needs must still work: memory, its two descriptors, and exit. */
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
    const struct umbb_bake_sandbox half = {.seccomp = 1}, other = {.landlock_abi = 6};
    assert_string_equal(umbb_bake_sandbox_level(&half), "reduced");
    assert_string_equal(umbb_bake_sandbox_level(&other), "reduced");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_forbidden_act_is_denied),
        cmocka_unit_test(landlock_denies_by_itself),
        cmocka_unit_test_setup_teardown(a_bake_cannot_touch_what_is_not_its_own, make_ground,
                                        remove_ground),
        cmocka_unit_test_setup_teardown(the_bakes_landlock_denies_by_itself, make_ground,
                                        remove_ground),
        cmocka_unit_test_setup_teardown(a_bake_can_work_inside, make_ground, remove_ground),
        cmocka_unit_test_setup_teardown(the_bakes_tries_succeed_outside, make_ground,
                                        remove_ground),
        cmocka_unit_test(the_tries_succeed_outside_the_sandbox),
        cmocka_unit_test(an_importer_can_work_inside),
        cmocka_unit_test(a_missing_filter_is_no_sandbox),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
