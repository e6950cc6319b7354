/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_STUDY_OUTPUT_GUARD_H
#define UMBRAGE_SERVER_STUDY_OUTPUT_GUARD_H
/*
 * Replacing a file as umbs_file does; SIGINT, SIGTERM, SIGHUP or SIGXCPU meanwhile end the process
 * as usual but take the temporary with them. One output at a time, by one thread.
 * A signal that was ignored when the program started (nohup) stays so.
 *
 * The path "-" is stdout, which is written to as it comes.
 */
#include "common/file.h"

/* NULL, no output, is not. */
int umbt_output_is_stdout(const char *path);

/* Where a command with that output says what it did: stderr if the output is stdout. */
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

/* All three for bytes that are there. Fails: as umbs_file_begin, umbs_file_write, umbs_file_commit.
 */
UMB_CHECKED enum umb_status umbt_output_replace(const char *path, const void *bytes, size_t size,
                                                struct umb_error *error);

#endif
