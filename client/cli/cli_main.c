/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage: finds the sub-command and runs it. */
#include "cli/shared/cli_common.h"
#include "umbrage/version.h"

#include <stdio.h>
#include <string.h>

static int run_help(int argc, char **argv);

static int run_version(int argc, char **argv)
{
    const bool as_json = argc == 2 && strcmp(argv[1], "--json") == 0;
    if (argc > 1 && !as_json) {
        return umbc_usage_error("version", "takes --json and nothing else, not '%.80s'", argv[1]);
    }
    (void)puts(as_json ? "{\"program\":\"umbrage\",\"version\":\"" UMB_VERSION_TEXT "\"}"
                       : "umbrage " UMB_VERSION_TEXT);
    return umbc_finish_stdout(0);
}

struct command {
    const char *name;
    int (*run)(int argc, char **argv); /* NULL: `program` runs it */
    const char *summary;
    const char *program, *word; /* Program beside this one, and the word before the arguments */
};

#define ROW(word, run, summary) {word, run, summary, NULL, NULL},
static const struct command COMMANDS[] = {
    UMBC_COMMANDS(ROW) /* and those that start another program: */
    {"bake", NULL, "bake a scene (starts umbrage-bake)", "umbrage-bake", NULL},
    {"study", NULL, "measure techniques against rays (starts umbrage-study)", "umbrage-study",
     NULL},
    {"render", NULL, "draw a scene with its shadows (starts umbrage-study)", "umbrage-study",
     "render"},
    {"points", NULL, "write sample points of a scene (starts umbrage-study)", "umbrage-study",
     "points"},
    {"aliasing", NULL, "compare texels of shadow maps with pixels (starts umbrage-study)",
     "umbrage-study", "aliasing"},
    {"techniques", NULL, "compare shadow maps with rays (starts umbrage-study)", "umbrage-study",
     "techniques"},
    {"deep", NULL, "compare deep shadow maps with rays (starts umbrage-study)", "umbrage-study",
     "deep"},
    {"help", run_help, "this text, or the help of a command", NULL, NULL},
    {"version", run_version, "print the version (--json: as an object)", NULL, NULL},
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
                "A daemon is found at --address, else UMBRAGE_ADDRESS, else " UMBU_DEFAULT_ADDRESS
                ";\nits token in --token-file, else UMBRAGE_TOKEN.\n"
                "Exit codes: 0 ok, 1 negative answer, 2 usage, 65 bad data, 66 no input,\n"
                "69 unavailable, 70 internal, 73 cannot create, 74 I/O, 75 temporary, 77 denied.\n",
                file);
}

static int run_command(const struct command *command, int argc, char **argv)
{
    return command->run != NULL
               ? command->run(argc, argv)
               : umbc_start_program(command->name, command->program, command->word, argv + 1);
}

static int run_help(int argc, char **argv)
{
    const struct command *command = argc > 1 ? find_command(argv[1]) : NULL;
    if (argc > 1 && command == NULL && argv[1][0] != '-') {
        return umbc_usage_error("help", "no command '%.80s'; see umbrage help", argv[1]);
    }
    if (command == NULL || command->run == run_help || command->run == run_version) {
        print_overview(stdout);
        return umbc_finish_stdout(0);
    }
    char option[] = "--help";
    char *arguments[] = {argv[1], option, NULL};
    return run_command(command, 2, arguments);
}

/* Prints a line for each command, followed by its options: see umbu_print_rows. The kind is
 * `command`, or `program` with the name of the program that is started. */
static int print_options(void)
{
    char option[] = "--print-options";
    for (size_t i = 0; i < COMMAND_COUNT; i++) {
        const struct command *command = &COMMANDS[i];
        (void)printf("umbrage\t%s\t\t\t%s\t%s%s%s\t\t\t%s\n", command->name,
                     command->run != NULL ? "command" : "program",
                     command->program != NULL ? command->program : "",
                     command->word != NULL ? " " : "", command->word != NULL ? command->word : "",
                     command->summary);
        char *arguments[] = {(char *)(uintptr_t)command->name, option, NULL};
        if (command->run != NULL && command->run != run_help && command->run != run_version) {
            (void)command->run(2, arguments);
        }
    }
    return umbc_finish_stdout(0);
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
    if (argc == 2 && strcmp(argv[1], "--print-options") == 0) {
        return print_options();
    }
    if (strcmp(argv[1], "--version") == 0) {
        return run_version(argc - 1, argv + 1);
    }
    const struct command *command = find_command(argv[1]);
    if (command == NULL) {
        return umbc_usage_error(NULL, "no command '%.80s'; see umbrage --help", argv[1]);
    }
    return run_command(command, argc - 1, argv + 1);
}
