/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage: the command people type. Finds the sub-command and runs it. */
#include "cli_common.h"
#include "umbrage/version.h"

#include <stdio.h>
#include <string.h>

static int run_bake(int argc, char **argv)
{
    (void)argc;
    return umbc_start_program("bake", "umbrage-bake", NULL, argv + 1);
}

static int run_study(int argc, char **argv)
{
    (void)argc;
    return umbc_start_program("study", "umbrage-study", NULL, argv + 1);
}

static int run_render(int argc, char **argv)
{
    static const char *const prefix[] = {"render", NULL};
    (void)argc;
    return umbc_start_program("render", "umbrage-study", prefix, argv + 1);
}

static int run_points(int argc, char **argv)
{
    static const char *const prefix[] = {"points", NULL};
    (void)argc;
    return umbc_start_program("points", "umbrage-study", prefix, argv + 1);
}

static int run_aliasing(int argc, char **argv)
{
    static const char *const prefix[] = {"aliasing", NULL};
    (void)argc;
    return umbc_start_program("aliasing", "umbrage-study", prefix, argv + 1);
}

static int run_help(int argc, char **argv);

static int run_version(int argc, char **argv)
{
    const bool as_json = argc == 2 && strcmp(argv[1], "--json") == 0;
    if (argc > 1 && !as_json) {
        return umbc_usage_error("version: takes --json and nothing else, not '%s'", argv[1]);
    }
    (void)puts(as_json ? "{\"program\":\"umbrage\",\"version\":\"" UMB_VERSION_TEXT "\"}"
                       : "umbrage " UMB_VERSION_TEXT);
    return umbc_finish_stdout(0);
}

struct command {
    const char *name;
    int (*run)(int argc, char **argv);
    const char *summary;
};

static const struct command COMMANDS[] = {
    {"info", umbc_info, "what an asset is: lights, sizes, plan, settings"},
    {"query", umbc_query, "how much of a light reaches points"},
    {"list", umbc_list, "the assets of a daemon"},
    {"load", umbc_load, "load a daemon with queries and measure it"},
    {"submit", umbc_submit, "have a daemon bake a scene"},
    {"watch", umbc_watch, "a job's progress, to its end"},
    {"jobs", umbc_jobs, "your jobs"},
    {"cancel", umbc_cancel, "end a job"},
    {"fetch", umbc_fetch, "download an asset of yours"},
    {"rm", umbc_rm, "give an asset of yours up"},
    {"verify", umbc_verify, "prove a file's integrity and identity, or check it against its scene"},
    {"stream", umbc_paging, "fetch the part of an asset that is needed, coarse first"},
    {"derive", umbc_derive, "shadow maps for a GPU, from an asset alone"},
    {"frames", umbc_frames, "ask a daemon for one frame's shadows after the other"},
    {"pack", umbc_pack, "turn a file into the packed form (.umb)"},
    {"unpack", umbc_unpack, "turn a file into the mapped form (.umbm)"},
    {"bake", run_bake, "bake a scene (starts umbrage-bake)"},
    {"study", run_study, "measure techniques against rays (starts umbrage-study)"},
    {"render", run_render, "a picture of a scene with its shadows (starts umbrage-study)"},
    {"points", run_points, "sample points of a scene, for load tests (starts umbrage-study)"},
    {"aliasing", run_aliasing, "texels of shadow maps against pixels (starts umbrage-study)"},
    {"help", run_help, "this text, or the help of a command"},
    {"version", run_version, "print the version (--json: as an object)"},
};
#define COMMAND_COUNT (sizeof COMMANDS / sizeof COMMANDS[0])

static const struct command *find_command(const char *name)
{
    for (size_t i = 0; i < COMMAND_COUNT; i++) {
        if (strcmp(COMMANDS[i].name, name) == 0) {
            return &COMMANDS[i];
        }
    }
    return NULL;
}

static void print_overview(FILE *file)
{
    (void)fputs("usage: umbrage COMMAND [arguments]\n\ncommands:\n", file);
    for (size_t i = 0; i < COMMAND_COUNT; i++) {
        (void)fprintf(file, "  %-10s %s\n", COMMANDS[i].name, COMMANDS[i].summary);
    }
    (void)fputs("\n`umbrage COMMAND --help` shows every option of a command.\n"
                "A daemon is found at --address, else UMBRAGE_ADDRESS, else " UMBC_DEFAULT_ADDRESS
                ";\nits token in --token-file, else UMBRAGE_TOKEN.\n"
                "Exit codes: 0 ok, 1 negative answer, 2 usage, 65 bad data, 66 no input,\n"
                "69 unavailable, 70 internal, 73 cannot create, 74 I/O, 75 temporary, 77 denied.\n",
                file);
}

static int run_help(int argc, char **argv)
{
    const struct command *command = argc > 1 ? find_command(argv[1]) : NULL;
    if (argc > 1 && command == NULL && argv[1][0] != '-') {
        return umbc_usage_error("help: no command '%s'", argv[1]);
    }
    if (command == NULL || command->run == run_help || command->run == run_version) {
        print_overview(stdout);
        return umbc_finish_stdout(0);
    }
    char option[] = "--help";
    char *arguments[] = {argv[1], option, NULL};
    return command->run(2, arguments);
}

int main(int argc, char **argv)
{
    if (argc < 2) {
        print_overview(stderr);
        return UMBC_EXIT_USAGE;
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
        print_overview(stdout);
        return umbc_finish_stdout(0);
    }
    if (strcmp(argv[1], "--version") == 0) {
        return run_version(argc - 1, argv + 1);
    }
    const struct command *command = find_command(argv[1]);
    if (command == NULL) {
        return umbc_usage_error("no command '%s'", argv[1]);
    }
    return command->run(argc - 1, argv + 1);
}
