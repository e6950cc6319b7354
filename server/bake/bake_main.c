/* SPDX-License-Identifier: Apache-2.0 */
/* main of umbrage-bake: the command, and the importer process, which runs the same program. */
#include <stdio.h>
#include <string.h>

#include "bake/options/bake_options.h"
#include "bake/bake_run.h"
#include "bake/import/import_job.h"
#include "bake/sandbox/doctor.h"
#include "common/child_process.h"
#include "tool/exit_code.h"
#include "umbrage/version.h"

int main(int argc, char **argv)
{
    umbs_standard_streams_open();
    if (argc > 1 && strcmp(argv[1], "import-child") == 0) {
        return umbb_import_child(argc, argv);
    }
    if (argc > 1 && strcmp(argv[1], "doctor") == 0) {
        return umbb_doctor(argc, argv);
    }
    if (argc == 2 && strcmp(argv[1], "--print-options") == 0) {
        static const char *const commands[] = {"tile", "merge", "import", "doctor"};
        char doctor[] = "doctor", *words[] = {argv[0], doctor, argv[1], NULL};
        for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
            printf("umbrage-bake\t%s\t\t\tcommand\t\t\t\t\n", commands[i]);
        }
        umbu_print_rows(&umbb_command, stdout);
        return umbb_doctor(3, words);
    }
    struct umbb_options options;
    struct umb_error error = {0};
    enum umb_status status = umbb_options_parse(argc, argv, &options, &error);
    if (status == UMB_OK && options.help) {
        umbu_print_help(&umbb_command, stdout);
        return fflush(stdout) != 0;
    }
    if (status == UMB_OK && options.version) {
        return puts("umbrage-bake " UMB_VERSION_TEXT) < 0 || fflush(stdout) != 0;
    }
    if (status == UMB_OK) {
        status = umbb_run(&options, &error);
    }
    if (status != UMB_OK) {
        fprintf(stderr, "umbrage-bake: %s\n",
                error.message[0] != '\0' ? error.message : umb_status_text(status));
    }
    return umbu_exit_code(status);
}
