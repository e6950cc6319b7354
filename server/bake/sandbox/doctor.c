/* SPDX-License-Identifier: Apache-2.0 */
/* Tries every forbidden act in a sandbox of its own and reports (doctor.h). */
#define _GNU_SOURCE /* CPU affinity */
#include "bake/sandbox/doctor.h"

#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/utsname.h>
#include <sys/wait.h>
#include <unistd.h>

#include "bake/sandbox/doctor_acts.h"
#include "bake/sandbox/sandbox.h"

#define EXIT_NO_SANDBOX  3 /* of the process that tries an act */
#define EXIT_UNAVAILABLE 69

static const char *const verdicts[] = {"ALLOWED", "refused", "killed"};

static const char help[] =
    "umbrage-bake doctor [--json | --quiet]    check the importer's sandbox and this machine\n"
    "\n"
    "Tries what a hostile scene file could make the importer do, each in a sandboxed process of\n"
    "its own, and says which layers this kernel offers. `full`: all of them; `reduced`: without\n"
    "namespaces or Landlock, the filter still denies every act; `exempt`: a sanitizer build.\n"
    "With --quiet the exit code says it all.\n"
    "\n"
    "Exit codes: 0 every act is denied (or the build is exempt), 1 an act is allowed, 2 usage,\n"
    "69 a required layer is missing: scenes are then not read at all.\n";

/* Refused for want of a right, not because the call makes no sense. */
static int is_refusal(int code)
{
    return code == EACCES || code == EPERM || code == ENOSYS;
}

static void attempt(unsigned index, int sandboxed)
{
    struct umbb_sandbox sandbox;
    if (sandboxed && umbb_sandbox_enter(&sandbox, NULL) != UMB_OK) {
        _exit(EXIT_NO_SANDBOX);
    }
    errno = 0;
    long result = umbb_acts[index].attempt();
    _exit(result < 0 && is_refusal(errno) ? UMBB_ACT_REFUSED : UMBB_ACT_ALLOWED);
}

int umbb_doctor_try(unsigned index, int sandboxed)
{
    int status;
    pid_t ended, child = fork();
    if (child == 0) {
        struct rlimit none = {0, 0};
        (void)setrlimit(RLIMIT_CORE, &none);
        attempt(index, sandboxed);
    }
    if (child < 0) {
        return -1;
    }
    do {
        ended = waitpid(child, &status, 0);
    } while (ended < 0 && errno == EINTR);
    if (ended == child && WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS) {
        return UMBB_ACT_KILLED;
    }
    if (ended == child && WIFEXITED(status) && WEXITSTATUS(status) <= UMBB_ACT_REFUSED) {
        return WEXITSTATUS(status);
    }
    return -1;
}

/* Enters the sandbox in a process of its own, to learn its layers. Out: 0, or -1. */
static int probe(struct umbb_sandbox *out)
{
    int ends[2];
    memset(out, 0, sizeof(*out));
    if (pipe(ends) != 0) {
        return -1;
    }
    pid_t child = fork();
    if (child == 0) {
        /* The filter lets nobody write but to descriptor 2. */
        struct umb_error error;
        if (dup2(ends[1], STDERR_FILENO) < 0) {
            _exit(1);
        }
        if (umbb_sandbox_enter(out, &error) != UMB_OK) {
            out->seccomp = 0;
        }
        _exit(write(STDERR_FILENO, out, sizeof(*out)) != (ssize_t)sizeof(*out));
    }
    (void)close(ends[1]);
    ssize_t got = child > 0 ? read(ends[0], out, sizeof(*out)) : -1;
    (void)close(ends[0]);
    while (child > 0 && waitpid(child, NULL, 0) < 0 && errno == EINTR) {
    }
    return got == (ssize_t)sizeof(*out) ? 0 : -1;
}

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

static void print_layers(const struct umbb_sandbox *layers, int json)
{
    printf(json ? "\"sandbox\":\"%s\",\"seccomp\":%s,\"landlock_abi\":%d,\"namespaces\":%s,"
                : "sandbox     %s: seccomp %s, Landlock ABI %d, namespaces %s\n",
           umbb_sandbox_level(layers), layers->seccomp ? "true" : "false", layers->landlock_abi,
           layers->namespaces ? "true" : "false");
}

/* Out: acts that are not denied. */
static unsigned try_all(int json)
{
    unsigned allowed = 0;
    if (json) {
        printf("\"acts\":{");
    }
    for (unsigned i = 0; i < umbb_act_count; i++) {
        int verdict = umbb_doctor_try(i, 1);
        const char *word = verdict < 0 ? "UNKNOWN" : verdicts[verdict];
        allowed += verdict <= UMBB_ACT_ALLOWED;
        if (json) {
            printf("%s\"%s\":\"%s\"", i == 0 ? "" : ",", umbb_acts[i].name, word);
        } else {
            printf("  %-32s %s\n", umbb_acts[i].name, word);
        }
    }
    printf(json ? "}," : "");
    return allowed;
}

static int examine(int json)
{
    struct umbb_sandbox layers;
    unsigned allowed = 0;
    int code = 0;
    if (probe(&layers) != 0 || (!layers.seccomp && !umbb_sandbox_exempt())) {
        code = EXIT_UNAVAILABLE;
    }
    printf(json ? "{" : "");
    print_machine(json);
    print_layers(&layers, json);
    if (code == 0 && !umbb_sandbox_exempt()) {
        allowed = try_all(json);
        code = allowed > 0;
    }
    printf(json ? "\"allowed\":%u}\n" : "allowed     %u\n", allowed);
    return fflush(stdout) != 0 ? 74 : code;
}

int umbb_doctor(int argc, char **argv)
{
    int json = argc == 3 && strcmp(argv[2], "--json") == 0;
    if (argc == 3 && (strcmp(argv[2], "--help") == 0 || strcmp(argv[2], "-h") == 0)) {
        return fputs(help, stdout) < 0 || fflush(stdout) != 0;
    }
    const int quiet = argc == 3 && strcmp(argv[2], "--quiet") == 0;
    if (argc > 2 && !json && !quiet) {
        fprintf(stderr, "umbrage-bake doctor: '%.64s' is not an option; see --help\n", argv[2]);
        return 2;
    }
    if (quiet && freopen("/dev/null", "w", stdout) == NULL) {
        return 74;
    }
    return examine(json);
}
