/* SPDX-License-Identifier: Apache-2.0 */
/* Tries every forbidden act in a sandbox of its own and reports (doctor.h). */
#define _GNU_SOURCE /* CPU affinity */
#include "bake/sandbox/doctor.h"

#include <errno.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "common/json_text.h"
#include "tool/exit_code.h"
#include "tool/options.h"

#define EXIT_UNAVAILABLE 69
#define FORBID_MAX       16

static const char *const verdicts[] = {"ALLOWED", "refused", "killed", "UNCLEAR"};

struct request {
    int json, quiet;
    const char *forbid[FORBID_MAX + 1]; /* NULL behind the last */
};
#define AT(field) UMBU_AT(struct request, field)

static const struct umbu_option OPTIONS[] = {
    {"forbid", "FILE",
     "also try to read this file in the bake's sandbox, up to 16 times: tokens, jobs.db, another "
     "owner's bundle",
     UMBU_LIST(FORBID_MAX), AT(forbid)},
    {"json", NULL, "print one JSON object", UMBU_FLAG, AT(json), .excludes = "quiet"},
    {"quiet", NULL, "print nothing; see the exit code", UMBU_FLAG, AT(quiet), .letter = 'q'},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage-bake doctor",
    .usage = "umbrage-bake doctor [--json | --quiet] [--forbid FILE]...",
    .summary = "Checks the sandboxes of importer and bake, and this machine. Tries the actions\n"
               "of a hostile scene, each in a separate sandboxed process and a temporary folder,\n"
               "and prints the level of each sandbox. `full`: every layer; `reduced`: namespaces\n"
               "or Landlock are missing, and the importer's filter still denies every action;\n"
               "`exempt`: a sanitizer build. Actions on paths run once more with Landlock alone,\n"
               "so that no other layer hides a gap.",
    .notes = "Exit codes: 0 every action is denied and a bake works (or the build is exempt),\n"
             "1 an action is allowed or a bake does not work, 2 usage, 69 a required layer is\n"
             "missing: the importer's filter, or a layer of the bake's sandbox that jobs need\n"
             "(umbraged --job-sandbox), 73 no temporary folder.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}},
};

static int has_avx2(void)
{
#if defined(__x86_64__)
    return __builtin_cpu_supports("avx2") != 0;
#else
    return 0;
#endif
}

/* Processors that this process may run on. */
static long processors(void)
{
    cpu_set_t set;
    return sched_getaffinity(0, sizeof(set), &set) == 0 ? CPU_COUNT(&set)
                                                        : sysconf(_SC_NPROCESSORS_ONLN);
}

/* Bytes, or -1 for no limit. */
static long long limit_of(int resource)
{
    struct rlimit value = {RLIM_INFINITY, RLIM_INFINITY};
    (void)getrlimit((__rlimit_resource_t)resource, &value);
    return value.rlim_cur == RLIM_INFINITY ? -1 : (long long)value.rlim_cur;
}

static void print_machine(int json)
{
    struct utsname kernel;
    if (uname(&kernel) != 0) {
        memset(&kernel, 0, sizeof(kernel));
    }
    const long long memory = (long long)sysconf(_SC_PHYS_PAGES) * sysconf(_SC_PAGESIZE);
    printf(json ? "\"kernel\":\"%s\",\"machine\":\"%s\",\"processors\":%ld,\"avx2\":%s,"
                  "\"memory_bytes\":%lld,\"limit_address_space\":%lld,\"limit_files\":%lld,"
                : "kernel      %s\nmachine     %s\nprocessors  %ld\navx2        %s\n"
                  "memory      %lld bytes; address space limit %lld, descriptors %lld (-1: none)\n",
           kernel.release, kernel.machine, processors(), has_avx2() ? "true" : "false", memory,
           limit_of(RLIMIT_AS), limit_of(RLIMIT_NOFILE));
}

static const char *truth(int value)
{
    return value ? "true" : "false";
}

static void print_layers(const struct umbb_sandbox *layers, int json)
{
    printf(json ? "\"sandbox\":\"%s\",\"seccomp\":%s,\"landlock_abi\":%d,\"namespaces\":%s,"
                : "sandbox     %s: seccomp %s, Landlock ABI %d, namespaces %s\n",
           umbb_sandbox_level(layers), truth(layers->seccomp), layers->landlock_abi,
           truth(layers->namespaces));
}

static void print_bake_layers(const struct umbb_bake_sandbox *layers, int json)
{
    printf(json ? "\"bake_sandbox\":\"%s\",\"bake_seccomp\":%s,\"bake_landlock_abi\":%d,"
                : "bake        %s: seccomp %s, Landlock ABI %d\n",
           umbb_bake_sandbox_level(layers), truth(layers->seccomp), layers->landlock_abi);
}

static void print_line(const char *name, const char *word, int json, int first)
{
    if (json) {
        printf("%s", first ? "" : ",");
        umbs_json_text(stdout, name);
        printf(":\"%s\"", word);
    } else {
        printf("  %-32s %s\n", name, word);
    }
}

/* A table of acts, those of one place, in one cage. */
struct series {
    const char *title; /* the name in JSON */
    const char *words; /* the line above the acts */
    const struct umbb_act *acts;
    size_t count;
    unsigned place;
    enum umbb_cage cage;
};

/* Out: acts that are not denied. */
static unsigned try_series(const struct series *series, const struct umbb_ground *ground, int json)
{
    unsigned allowed = 0;
    int first = 1;
    printf(json ? "\"%s\":{" : "%s\n", json ? series->title : series->words);
    for (size_t i = 0; i < series->count; i++) {
        const struct umbb_act *act = &series->acts[i];
        if ((act->places & series->place) == 0) {
            continue;
        }
        const int verdict = umbb_doctor_try(act, series->cage, ground);
        allowed += verdict != UMBB_ACT_REFUSED && verdict != UMBB_ACT_KILLED;
        print_line(act->name, verdict < 0 ? "UNKNOWN" : verdicts[verdict], json, first);
        first = 0;
    }
    printf(json ? "}," : "");
    return allowed;
}

/* Out: files that can be read. */
static unsigned try_forbidden(const struct request *request, const struct umbb_ground *ground)
{
    unsigned allowed = 0;
    printf(request->json                ? "\"forbidden\":{"
           : request->forbid[0] != NULL ? "bake, files of --forbid\n"
                                        : "");
    for (size_t i = 0; request->forbid[i] != NULL; i++) {
        umbb_bake_acts_forbid(request->forbid[i]);
        const int verdict = umbb_doctor_try(&umbb_bake_act_forbidden, UMBB_CAGE_BAKE, ground);
        allowed += verdict != UMBB_ACT_REFUSED;
        print_line(request->forbid[i], verdict < 0 ? "UNKNOWN" : verdicts[verdict], request->json,
                   i == 0);
    }
    printf(request->json ? "}," : "");
    return allowed;
}

/* Out: needs that are not met. */
static unsigned try_needs(const struct umbb_ground *ground, int json)
{
    unsigned broken = 0;
    printf(json ? "\"needs\":{" : "bake, what it needs\n");
    for (size_t i = 0; i < umbb_bake_need_count; i++) {
        const int works =
            umbb_doctor_try(&umbb_bake_needs[i], UMBB_CAGE_BAKE, ground) == UMBB_ACT_ALLOWED;
        broken += !works;
        print_line(umbb_bake_needs[i].name, works ? "works" : "BROKEN", json, i == 0);
    }
    printf(json ? "}," : "");
    return broken;
}

static unsigned try_all(const struct request *request, const struct umbb_ground *ground,
                        int landlock)
{
    const struct series all[] = {
        {"acts", "importer", umbb_acts, umbb_act_count, UMBB_IN_IMPORTER, UMBB_CAGE_IMPORTER},
        {"bake_acts", "bake, files of others", umbb_bake_acts, umbb_bake_act_count, UMBB_IN_BAKE,
         UMBB_CAGE_BAKE},
        {"bake_calls", "bake, other calls", umbb_acts, umbb_act_count, UMBB_IN_BAKE,
         UMBB_CAGE_BAKE},
        {"landlock_acts", "importer, Landlock alone", umbb_acts, umbb_act_count, UMBB_IN_LANDLOCK,
         UMBB_CAGE_LANDLOCK},
        {"bake_landlock_acts", "bake, Landlock alone", umbb_bake_acts, umbb_bake_act_count,
         UMBB_IN_BAKE_PATHS, UMBB_CAGE_BAKE_PATHS},
    };
    const size_t count = landlock ? sizeof all / sizeof all[0] : 1;
    unsigned allowed = 0;
    for (size_t i = 0; i < count; i++) {
        allowed += try_series(&all[i], ground, request->json);
    }
    return landlock ? allowed + try_forbidden(request, ground) + try_needs(ground, request->json)
                    : allowed;
}

static int examine(const struct request *request, const struct umbb_ground *ground)
{
    const int json = request->json;
    struct umbb_sandbox layers;
    struct umbb_bake_sandbox bake;
    unsigned allowed = 0;
    const int importer = umbb_doctor_probe(&layers) == 0 && layers.seccomp;
    const int baker =
        umbb_doctor_probe_bake(ground, &bake) == 0 && bake.seccomp && bake.landlock_abi > 0;
    int code = umbb_sandbox_exempt() || (importer && baker) ? 0 : EXIT_UNAVAILABLE;
    printf(json ? "{" : "");
    print_machine(json);
    print_layers(&layers, json);
    print_bake_layers(&bake, json);
    if (importer && !umbb_sandbox_exempt()) {
        umbb_bake_acts_on(ground);
        allowed = try_all(request, ground, baker);
        code = allowed > 0 ? 1 : code;
    }
    printf(json ? "\"allowed\":%u}\n" : "allowed     %u\n", allowed);
    return fflush(stdout) != 0 ? 74 : code;
}

int umbb_doctor(int argc, char **argv)
{
    struct request request = {.json = 0};
    struct umbb_ground ground;
    struct umb_error error;
    struct umbu_parsed parsed;
    int code = umbu_start(&parsed, &COMMAND, argc - 1, argv + 1, &request);
    if (code >= 0) {
        return code;
    }
    if (request.quiet && freopen("/dev/null", "w", stdout) == NULL) {
        return 74;
    }
    const enum umb_status status = umbb_ground_make(&ground, &error);
    if (status != UMB_OK) {
        fprintf(stderr, "umbrage-bake doctor: %s\n", error.message);
        return umbu_exit_code(status);
    }
    code = examine(&request, &ground);
    umbb_ground_remove(&ground);
    return code;
}
