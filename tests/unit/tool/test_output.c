/* SPDX-License-Identifier: Apache-2.0 */
/* Output files must appear whole or not at all, however the program ends. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tool/output.h"

static char folder[] = "umbrage-output-XXXXXX";

static void folder_make(void)
{
    memset(folder + strlen(folder) - 6, 'X', 6);
    assert_non_null(mkdtemp(folder));
}

/* Path of a file in the folder; good until the next but three. */
static const char *folder_file(const char *name)
{
    static char paths[4][64];
    static unsigned next;
    char *path = paths[next++ % 4];
    (void)snprintf(path, sizeof paths[0], "%s/%s", folder, name);
    return path;
}

/* Removes the file "a" and the folder, in which nothing else may be left. */
static void folder_remove(void)
{
    (void)unlink(folder_file("a"));
    assert_int_equal(rmdir(folder), 0);
}

static size_t count_files(const char *path)
{
    size_t count = 0;
    DIR *listing = opendir(path);
    struct dirent *item;
    while (listing != NULL && (item = readdir(listing)) != NULL) {
        count += strcmp(item->d_name, ".") != 0 && strcmp(item->d_name, "..") != 0;
    }
    closedir(listing);
    return count;
}

static void assert_content(const char *path, const char *expected)
{
    char text[64] = {0};
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    size_t count = fread(text, 1, sizeof text - 1, file);
    fclose(file);
    assert_int_equal(count, strlen(expected));
    assert_string_equal(text, expected);
}

static void write_text(const char *path, const char *text)
{
    struct umbu_output file;
    assert_int_equal(umbu_output_begin(path, 0, &file, NULL), UMB_OK);
    assert_int_equal(umbu_output_write(&file, text, strlen(text), NULL), UMB_OK);
    assert_int_equal(umbu_output_commit(&file, NULL), UMB_OK);
    umbu_output_abandon(&file); /* harmless after commit */
}

static void file_commit_replaces_whole_content(void **state)
{
    (void)state;
    folder_make();
    write_text(folder_file("a"), "first, and longer");
    write_text(folder_file("a"), "second");
    assert_content(folder_file("a"), "second");
    assert_int_equal(count_files(folder), 1);
    folder_remove();
}

static void file_before_commit_shows_the_old_content(void **state)
{
    struct umbu_output file;
    (void)state;
    folder_make();
    write_text(folder_file("a"), "old");
    assert_int_equal(umbu_output_begin(folder_file("a"), 0, &file, NULL), UMB_OK);
    assert_int_equal(umbu_output_write(&file, "new", 3, NULL), UMB_OK);
    assert_content(folder_file("a"), "old");
    assert_int_equal(count_files(folder), 2);
    umbu_output_abandon(&file);
    assert_content(folder_file("a"), "old");
    assert_int_equal(count_files(folder), 1);
    folder_remove();
}

static void file_begin_refuses_what_is_no_regular_file(void **state)
{
    struct umbu_output file;
    struct umb_error error;
    (void)state;
    folder_make();
    assert_int_equal(umbu_output_begin(folder, 0, &file, &error), UMB_E_CANNOT_CREATE);
    assert_int_equal(umbu_output_begin("/dev/null", 0, &file, &error), UMB_E_CANNOT_CREATE);
    assert_non_null(strstr(error.message, "/dev/null"));
    assert_int_equal(umbu_output_begin(folder_file("no/such"), 0, &file, &error),
                     UMB_E_CANNOT_CREATE);
    assert_int_equal(umbu_output_begin(folder_file(""), 0, &file, &error), UMB_E_CANNOT_CREATE);
    umbu_output_abandon(&file);
    folder_remove();
}

static void file_commit_refuses_after_a_failed_write(void **state)
{
    struct umbu_output file;
    struct umb_error error;
    (void)state;
    folder_make();
    write_text(folder_file("a"), "old");
    assert_int_equal(umbu_output_begin(folder_file("a"), 0, &file, NULL), UMB_OK);
    /* A read-only descriptor imitates a full disk. */
    int read_only = open("/dev/null", O_RDONLY);
    assert_true(dup2(read_only, file.fd) >= 0);
    close(read_only);
    assert_int_equal(umbu_output_write(&file, "new", 3, &error), UMB_E_IO);
    assert_int_equal(umbu_output_write(&file, "", 0, &error), UMB_E_IO);
    assert_int_equal(umbu_output_commit(&file, &error), UMB_E_IO);
    assert_content(folder_file("a"), "old");
    assert_int_equal(count_files(folder), 1);
    folder_remove();
}

static void file_abandon_accepts_a_zeroed_struct(void **state)
{
    struct umbu_output file = {0};
    (void)state;
    umbu_output_abandon(&file);
    assert_int_equal(umbu_output_commit(&file, NULL), UMB_E_STATE);
}

static void commands_write_to_devices_and_keep_permissions(void **state)
{
    struct umbu_output output;
    struct umb_error error;
    struct stat info;
    (void)state;
    folder_make();
    write_text(folder_file("a"), "old");
    assert_int_equal(chmod(folder_file("a"), 0640), 0);
    assert_int_equal(umbu_output_check("/dev/null", UMBU_OUTPUT_COMMAND, &error), UMB_OK);
    assert_int_equal(umbu_output_replace("/dev/null", UMBU_OUTPUT_COMMAND, "x", 1, &error), UMB_OK);
    assert_int_equal(stat("/dev/null", &info), 0);
    assert_true(S_ISCHR(info.st_mode));
    assert_int_equal(umbu_output_begin(folder, UMBU_OUTPUT_COMMAND, &output, &error),
                     UMB_E_CANNOT_CREATE);
    assert_int_equal(umbu_output_begin(folder_file("a"), UMBU_OUTPUT_COMMAND, &output, &error),
                     UMB_OK);
    assert_true(fprintf(output.file, "%s", "new") == 3);
    assert_int_equal(umbu_output_commit(&output, &error), UMB_OK);
    assert_content(folder_file("a"), "new");
    assert_int_equal(stat(folder_file("a"), &info), 0);
    assert_int_equal(info.st_mode & 0777, 0640); /* of the file it replaced */
    assert_int_equal(umbu_output_replace(folder_file("a"), UMBU_OUTPUT_PRIVATE, "", 0, &error),
                     UMB_OK);
    assert_int_equal(stat(folder_file("a"), &info), 0);
    assert_int_equal(info.st_mode & 0777, 0600);
    assert_int_equal(info.st_size, 0);
    folder_remove();
}

/* Starts a child process that begins an output, writes half of it and gets a signal. Returns its
 * wait status. */
static int run_child(int number, int ignored)
{
    const pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        struct umbu_output output;
        if (ignored) {
            (void)signal(number, SIG_IGN);
        }
        if (umbu_output_begin(folder_file("a"), UMBU_OUTPUT_COMMAND, &output, NULL) != UMB_OK ||
            fputs("half", output.file) < 0 || raise(number) != 0) {
            _exit(1);
        }
        _exit(umbu_output_commit(&output, NULL) == UMB_OK ? 0 : 1);
    }
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    return status;
}

static void signals_take_the_temporary_with_them(void **state)
{
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP, SIGXCPU};
    (void)state;
    folder_make();
    write_text(folder_file("a"), "old");
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        const int status = run_child(numbers[i], 0);
        assert_true(WIFSIGNALED(status));
        assert_int_equal(WTERMSIG(status), numbers[i]);
        assert_content(folder_file("a"), "old");
        assert_int_equal(count_files(folder), 1);
    }
    const int status = run_child(SIGHUP, 1); /* nohup */
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    assert_content(folder_file("a"), "half");
    folder_remove();
}

static void errors_of_a_sink_are_explained_by_its_output(void **state)
{
    struct umbu_output output;
    struct umb_error error = {.status = UMB_OK};
    (void)state;
    folder_make();
    assert_int_equal(umbu_output_begin(folder_file("a"), 0, &output, NULL), UMB_OK);
    assert_int_equal(umbu_output_explain(&output, UMB_E_LIMIT, &error), UMB_E_LIMIT);
    assert_non_null(strstr(error.message, "a resource limit was reached"));
    assert_int_equal(umbu_output_explain(&output, UMB_E_CORRUPT, &error), UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "a resource limit was reached")); /* a sentence stays */
    output.system_error = ENOSPC;
    assert_int_equal(umbu_output_explain(&output, UMB_E_CORRUPT, &error), UMB_E_IO);
    assert_non_null(strstr(error.message, strerror(ENOSPC)));
    umbu_output_abandon(&output);
    folder_remove();
}

/* Writes `user`, a text, and fails if the text begins with '!'. */
static enum umb_status put_text(void *user, const struct umb_sink *sink, struct umb_error *error)
{
    const char *text = user;
    const enum umb_status status = sink->write(sink->user, text, strlen(text));
    (void)error;
    return text[0] == '!' ? UMB_E_CORRUPT : status;
}

static void a_failed_writer_leaves_the_old_file(void **state)
{
    struct umb_error error = {.status = UMB_OK};
    char good[] = "new", bad[] = "!bad";
    (void)state;
    folder_make();
    assert_int_equal(umbu_output_write_by(folder_file("a"), 0, put_text, good, &error), UMB_OK);
    assert_int_equal(umbu_output_write_by(folder_file("a"), 0, put_text, bad, &error),
                     UMB_E_CORRUPT);
    assert_non_null(strstr(error.message, "cannot write"));
    assert_content(folder_file("a"), "new");
    assert_int_equal(count_files(folder), 1);
    folder_remove();
}

static void a_command_talks_where_its_data_do_not_go(void **state)
{
    (void)state;
    assert_ptr_equal(umbu_output_talk("-"), stderr);
    assert_ptr_equal(umbu_output_talk(NULL), stdout);
}

static void folders_are_synced_or_their_error_told(void **state)
{
    (void)state;
    folder_make();
    assert_int_equal(umbu_folder_sync_at(AT_FDCWD, folder), 0);
    assert_int_equal(umbu_folder_sync_at(AT_FDCWD, folder_file("none")), -1);
    assert_int_equal(errno, ENOENT);
    assert_int_equal(umbu_folder_sync(-1), -1);
    assert_int_equal(errno, EBADF);
    folder_remove();
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(file_commit_replaces_whole_content),
        cmocka_unit_test(file_before_commit_shows_the_old_content),
        cmocka_unit_test(file_begin_refuses_what_is_no_regular_file),
        cmocka_unit_test(file_commit_refuses_after_a_failed_write),
        cmocka_unit_test(file_abandon_accepts_a_zeroed_struct),
        cmocka_unit_test(commands_write_to_devices_and_keep_permissions),
        cmocka_unit_test(signals_take_the_temporary_with_them),
        cmocka_unit_test(errors_of_a_sink_are_explained_by_its_output),
        cmocka_unit_test(a_failed_writer_leaves_the_old_file),
        cmocka_unit_test(a_command_talks_where_its_data_do_not_go),
        cmocka_unit_test(folders_are_synced_or_their_error_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
