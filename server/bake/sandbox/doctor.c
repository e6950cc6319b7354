/* SPDX-License-Identifier: Apache-2.0 */
/* Tries every forbidden act in a sandbox of its own and reports (doctor.h). */
#define _GNU_SOURCE /* CPU affinity */
#include "bake/sandbox/doctor.h"

#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "tool/exit_code.h"
#include "tool/json.h"
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

/* Prints facts about the machine. In: json: writer of JSON; NULL, here and below: prints text. */
static void print_machine(struct umbu_json *json)
{
    struct utsname kernel;
    if (uname(&kernel) != 0) {
        memset(&kernel, 0, sizeof(kernel));
    }
    const long long memory = (long long)sysconf(_SC_PHYS_PAGES) * sysconf(_SC_PAGESIZE);
    if (json == NULL) {
        printf("kernel      %s\nmachine     %s\nprocessors  %ld\navx2        %s\n"
               "memory      %lld bytes; address space limit %lld, descriptors %lld (-1: none)\n",
               kernel.release, kernel.machine, processors(), has_avx2() ? "true" : "false", memory,
               limit_of(RLIMIT_AS), limit_of(RLIMIT_NOFILE));
        return;
    }
    umbu_json_text(json, "kernel", kernel.release);
    umbu_json_text(json, "machine", kernel.machine);
    umbu_json_signed(json, "processors", processors());
    umbu_json_bool(json, "avx2", has_avx2());
    umbu_json_signed(json, "memory_bytes", memory);
    umbu_json_signed(json, "limit_address_space", limit_of(RLIMIT_AS));
    umbu_json_signed(json, "limit_files", limit_of(RLIMIT_NOFILE));
}

static const char *truth(int value)
{
    return value ? "true" : "false";
}

static void print_layers(const struct umbb_sandbox *layers, const struct umbb_bake_sandbox *bake,
                         struct umbu_json *json)
{
    if (json == NULL) {
        printf("sandbox     %s: seccomp %s, Landlock ABI %d, namespaces %s\n",
               umbb_sandbox_level(layers), truth(layers->seccomp), layers->landlock_abi,
               truth(layers->namespaces));
        printf("bake        %s: seccomp %s, Landlock ABI %d\n", umbb_bake_sandbox_level(bake),
               truth(bake->seccomp), bake->landlock_abi);
        return;
    }
    umbu_json_text(json, "sandbox", umbb_sandbox_level(layers));
    umbu_json_bool(json, "seccomp", layers->seccomp);
    umbu_json_signed(json, "landlock_abi", layers->landlock_abi);
    umbu_json_bool(json, "namespaces", layers->namespaces);
    umbu_json_text(json, "bake_sandbox", umbb_bake_sandbox_level(bake));
    umbu_json_bool(json, "bake_seccomp", bake->seccomp);
    umbu_json_signed(json, "bake_landlock_abi", bake->landlock_abi);
}

static void print_line(const char *name, const char *word, struct umbu_json *json)
{
    if (json != NULL) {
        umbu_json_text(json, name, word);
    } else {
        printf("  %-32s %s\n", name, word);
    }
}

/* Begins a table: an object, or a line of words above. */
static void begin_table(const char *title, const char *words, struct umbu_json *json)
{
    if (json != NULL) {
        umbu_json_begin(json, title, '{');
    } else {
        printf("%s\n", words);
    }
}

static void end_table(struct umbu_json *json)
{
    if (json != NULL) {
        umbu_json_end(json, '}');
    }
}

/* Acts of one place, tried in one cage and printed as a table. */
struct series {
    const char *title; /* name in JSON */
    const char *words; /* line above the acts */
    const struct umbb_act *acts;
    size_t count;
    unsigned place;
    enum umbb_cage cage;
};

/* Returns the number of acts that are not denied. */
static unsigned try_series(const struct series *series, const struct umbb_ground *ground,
                           struct umbu_json *json)
{
    unsigned allowed = 0;
    begin_table(series->title, series->words, json);
    for (size_t i = 0; i < series->count; i++) {
        const struct umbb_act *act = &series->acts[i];
        if ((act->places & series->place) != 0) {
            const int verdict = umbb_doctor_try(act, series->cage, ground);
            allowed += verdict != UMBB_ACT_REFUSED && verdict != UMBB_ACT_KILLED;
            print_line(act->name, verdict < 0 ? "UNKNOWN" : verdicts[verdict], json);
        }
    }
    end_table(json);
    return allowed;
}

static void make_absolute(const char *file, char path[UMBB_GROUND_PATH])
{
    char folder[UMBB_GROUND_PATH / 2] = "";
    const int is_below = file[0] != '/' && getcwd(folder, sizeof folder) != NULL;
    (void)snprintf(path, UMBB_GROUND_PATH, "%s%s%s", folder, is_below ? "/" : "", file);
}

/* Returns the number of files that can be read. */
static unsigned try_forbidden(const struct request *request, const struct umbb_ground *ground,
                              struct umbu_json *json)
{
    unsigned allowed = 0;
    if (json != NULL || request->forbid[0] != NULL) {
        begin_table("forbidden", "bake, files of --forbid", json);
    }
    for (size_t i = 0; request->forbid[i] != NULL; i++) {
        char path[UMBB_GROUND_PATH];
        make_absolute(request->forbid[i], path);
        const struct umbb_act act = {"read", UMBB_IN_BAKE, path, .flags = O_RDONLY | O_NONBLOCK};
        const int verdict = umbb_doctor_try(&act, UMBB_CAGE_BAKE, ground);
        allowed += verdict != UMBB_ACT_REFUSED;
        print_line(request->forbid[i], verdict < 0 ? "UNKNOWN" : verdicts[verdict], json);
    }
    end_table(json);
    return allowed;
}

/* Returns the number of needs that are not met. */
static unsigned try_needs(const struct umbb_ground *ground, struct umbu_json *json)
{
    unsigned broken = 0;
    begin_table("needs", "bake, what it needs", json);
    for (size_t i = 0; i < umbb_bake_need_count; i++) {
        const int works =
            umbb_doctor_try(&umbb_bake_needs[i], UMBB_CAGE_BAKE, ground) == UMBB_ACT_ALLOWED;
        broken += !works;
        print_line(umbb_bake_needs[i].name, works ? "works" : "BROKEN", json);
    }
    end_table(json);
    return broken;
}

static unsigned try_all(const struct request *request, const struct umbb_ground *ground,
                        int landlock, struct umbu_json *json)
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
        allowed += try_series(&all[i], ground, json);
    }
    return landlock ? allowed + try_forbidden(request, ground, json) + try_needs(ground, json)
                    : allowed;
}

static int examine(const struct request *request, const struct umbb_ground *ground)
{
    struct umbu_json writer = {.file = stdout};
    struct umbu_json *json = request->json ? &writer : NULL;
    struct umbb_sandbox layers;
    struct umbb_bake_sandbox bake;
    unsigned allowed = 0;
    const int importer = umbb_doctor_probe(&layers) == 0 && layers.seccomp;
    const int baker =
        umbb_doctor_probe_bake(ground, &bake) == 0 && bake.seccomp && bake.landlock_abi > 0;
    int code = umbb_sandbox_exempt() || (importer && baker) ? 0 : EXIT_UNAVAILABLE;
    if (json != NULL) {
        umbu_json_begin(json, NULL, '{');
    }
    print_machine(json);
    print_layers(&layers, &bake, json);
    if (importer && !umbb_sandbox_exempt()) {
        allowed = try_all(request, ground, baker, json);
        code = allowed > 0 ? 1 : code;
    }
    if (json != NULL) {
        umbu_json_integer(json, "allowed", allowed);
        umbu_json_close(json);
    } else {
        printf("allowed     %u\n", allowed);
    }
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
