/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_OUTPUT_GUARD_H
#define UMBRAGE_SERVER_STUDY_OUTPUT_GUARD_H
/*
 * Replacing a file as umbs_file does. SIGINT, SIGTERM, SIGHUP or SIGXCPU meanwhile end the process
 * as usual, after removing the temporary. One output at a time, by one thread. A signal that was
 * ignored when the program started (nohup) stays ignored.
 *
 * The path "-" is stdout, which is written to directly.
 */
#include "common/file.h"

/* 1 if the path is "-". NULL, for no output, is not. */
int umbt_output_is_stdout(const char *path);

/* Stream for a command's messages: stderr if the output is stdout, else stdout. */
FILE *umbt_output_talk(const char *path);

/* As umbs_file_check. */
UMB_CHECKED enum umb_status umbt_output_check(const char *path, struct umb_error *error);

/* As umbs_file_begin. */
UMB_CHECKED enum umb_status umbt_output_begin(const char *path, struct umbs_file *file,
                                              struct umb_error *error);

/* As umbs_file_commit. */
UMB_CHECKED enum umb_status umbt_output_commit(struct umbs_file *file, struct umb_error *error);

/* As umbs_file_abandon. */
void umbt_output_abandon(struct umbs_file *file);

/* umbt_output_begin, a write and umbt_output_commit in one call. Fails: as umbs_file_begin,
 * umbs_file_write, umbs_file_commit. */
UMB_CHECKED enum umb_status umbt_output_replace(const char *path, const void *bytes, size_t size,
                                                struct umb_error *error);

#endif
