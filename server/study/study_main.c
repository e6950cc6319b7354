/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage-study: finds and runs its sub-commands, which need rays and a scene beside an asset. */
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include "study/setup.h"
#include "tool/exit_code.h"
#include "umbrage/version.h"

static const char help[] =
    "usage: umbrage-study SCENE [-o DIR] [options]\n"
    "       umbrage-study COMMAND ...\n"
    "\n"
    "  SCENE [-o DIR]                               what accuracy costs: a report\n"
    "                                               (`umbrage-study study --help`)\n"
    "  render SCENE --asset FILE|ASSET -o OUT.png   a picture of a scene with its shadows\n"
    "  verify FILE --scene SCENE                    compare an asset with traced rays\n"
    "  points SCENE -o FILE                         sample points, for load tests\n"
    "  techniques SCENE                             shadow maps of the literature against rays\n"
    "  aliasing SCENE                               texels of shadow maps against pixels\n"
    "  deep SCENE                                   deep shadow maps against products\n"
    "\n"
    "`umbrage-study COMMAND --help` lists a command's options.\n"
    "  --version   --help\n";

static const struct {
    const char *name;
    const struct umbt_command *command;
} commands[] = {
    {"render", &umbt_render},       {"verify", &umbt_verify},         {"points", &umbt_points},
    {"study", &umbt_study_command}, {"techniques", &umbt_techniques}, {"aliasing", &umbt_aliasing},
    {"deep", &umbt_deep},
};

/* Flushes stdout. Returns code, or the code of a failed write: lost output must not look like
 * success. */
static int output_finish(int code)
{
    if ((fflush(stdout) != 0 || ferror(stdout)) && code <= 1) {
        fputs("umbrage-study: standard output could not be written\n", stderr);
        return umbu_exit_code(UMB_E_IO);
    }
    return code;
}

int main(int argc, char **argv)
{
    /* Makes a write to a closed pipe or connection fail, instead of ending the process. */
    (void)signal(SIGPIPE, SIG_IGN);
    (void)signal(SIGXFSZ, SIG_IGN); /* and a write beyond the file size limit */
    if (argc < 2) {
        fputs(help, stderr);
        return umbu_exit_code(UMB_E_ARGUMENT);
    }
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
        if (strcmp(argv[1], commands[i].name) == 0) {
            return output_finish(umbt_command_run(commands[i].command, argc - 1, argv + 1));
        }
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 ||
        strcmp(argv[1], "help") == 0) {
        char option[] = "--help", *words[] = {argv[0], option, NULL};
        fputs(help, stdout);
        putchar('\n');
        return output_finish(umbt_command_run(&umbt_study_command, 2, words));
    }
    if (strcmp(argv[1], "--print-options") == 0) {
        for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
            printf("umbrage-study\t%s\t\t\tcommand\t\t\t\t\n", commands[i].name);
            (void)umbt_command_run(commands[i].command, 2, argv);
        }
        return output_finish(0);
    }
    if (strcmp(argv[1], "--version") == 0) {
        puts("umbrage-study " UMB_VERSION_TEXT);
        return output_finish(0);
    }
    if (strpbrk(argv[1], "./") == NULL) { /* not a scene's name */
        fprintf(stderr, "umbrage-study: '%.80s' is not a command; see umbrage-study --help\n",
                argv[1]);
        return umbu_exit_code(UMB_E_ARGUMENT);
    }
    return output_finish(umbt_command_run(&umbt_study_command, argc, argv));
}
