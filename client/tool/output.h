/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_TOOL_OUTPUT_H
#define UMBRAGE_TOOL_OUTPUT_H
/*
 * Output files that appear whole or not at all.
 *
 *     umbu_output_begin("city.umb", UMBU_OUTPUT_COMMAND, &output, &error);
 *     umbu_output_write(&output, bytes, count, &error);    or fprintf(output.file, ...)
 *     umbu_output_commit(&output, &error);
 *     umbu_output_abandon(&output);                        harmless after commit
 *
 * A commit syncs a temporary beside the target, renames it and syncs the folder. A crash at any
 * step leaves the old file or the new one, and at most a stray `.tmp.` file, which the daemon's
 * store sweeps. A failed fsync is never repeated: the temporary is removed.
 *
 * Threads: one thread an output. Outputs of commands share one signal handler: one at a time.
 */
#include <stdbool.h>
#include <stdio.h>
#include "umbrage/file.h"

enum umbu_output_flags {
    UMBU_OUTPUT_PRIVATE = 1, /* Mode 0600 whatever the umask. */
    /*
     * Output of a command. "-" means stdout; a device or pipe is written to directly; a new file
     * keeps the permissions of the file that it replaces. SIGINT, SIGTERM, SIGHUP and SIGXCPU
     * remove the temporary and then act as usual; a signal ignored at the start (nohup) stays
     * ignored.
     */
    UMBU_OUTPUT_COMMAND = 2,
};

struct umbu_output {
    FILE *file;       /* Stream of a command's output; NULL for others. */
    int fd;           /* Descriptor of the output; -1 = closed. */
    char *path;       /* Name of the target, "stdout" for "-"; NULL = nothing begun. */
    char *temporary;  /* Name of the file beside it; NULL for stdout, devices and pipes. */
    bool guarded;     /* true: a signal removes the temporary. */
    bool unsynced;    /* true: commit syncs nothing; the caller syncs many files together. */
    int system_error; /* errno of the first failed write, else 0; commit then refuses. */
};

/*
 * Checks whether path can be replaced, so that a long run fails at its start. Writes nothing.
 * Fails: E_CANNOT_CREATE where umbu_output_begin would.
 */
UMB_CHECKED enum umb_status umbu_output_check(const char *path, unsigned flags,
                                              struct umb_error *error);

/* Starts an output. In: flags: of enum umbu_output_flags. Fails: E_CANNOT_CREATE, E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbu_output_begin(const char *path, unsigned flags,
                                              struct umbu_output *output, struct umb_error *error);

/* Appends bytes. Fails: E_IO (disk full and the like); the output must still be abandoned. */
UMB_CHECKED enum umb_status umbu_output_write(struct umbu_output *output, const void *bytes,
                                              size_t count, struct umb_error *error);

/*
 * Makes the new content durable and visible. On failure the temporary is removed.
 * Fails: E_IO, E_CANNOT_CREATE; E_STATE if nothing was begun.
 */
UMB_CHECKED enum umb_status umbu_output_commit(struct umbu_output *output, struct umb_error *error);

/* Removes the temporary. Harmless after commit and on a zeroed struct. */
void umbu_output_abandon(struct umbu_output *output);

/* A core sink that appends to the output, which must stay where it is. */
struct umb_sink umbu_output_sink(struct umbu_output *output);

/*
 * Completes the error message of a writer function of the core, which knows only that its sink
 * failed.
 *
 * In: status: result of the writer. error: if the writer made a message, the message stays. Returns
 *     the status.
 */
enum umb_status umbu_output_explain(const struct umbu_output *output, enum umb_status status,
                                    struct umb_error *error);

/* Writes the content of an output file into a sink. */
typedef enum umb_status (*umbu_writer_fn)(void *user, const struct umb_sink *sink,
                                          struct umb_error *error);

/* Writes a file by a writer of the core: begin, write, commit. The writer knows only that the sink
 * failed, so `error`, never NULL here, gets the cause. Fails: as writer, umbu_output_begin and
 * umbu_output_commit. */
UMB_CHECKED enum umb_status umbu_output_write_by(const char *path, unsigned flags,
                                                 umbu_writer_fn writer, void *user,
                                                 struct umb_error *error);

/* Writes a whole file: begin, write and commit. Fails: as these three. */
UMB_CHECKED enum umb_status umbu_output_replace(const char *path, unsigned flags, const void *bytes,
                                                size_t size, struct umb_error *error);

/* Writes all bytes to a descriptor. Returns 0 or an errno. */
int umbu_write_all(int fd, const char *from, size_t count);

/* Renames a synced file within its folder and syncs the folder. Fails: E_IO, E_CANNOT_CREATE. */
UMB_CHECKED enum umb_status umbu_output_rename(const char *from, const char *to,
                                               struct umb_error *error);

/* True for "-". NULL, no output, is not stdout. */
bool umbu_output_is_stdout(const char *path);

/* Stream for a command's messages: stderr if its output is stdout. */
FILE *umbu_output_talk(const char *path);

/*
 * Makes the names in a folder durable. If the file system cannot sync a folder (EINVAL, ENOTSUP),
 * that counts as success. _at opens the folder relative to the descriptor parent (AT_FDCWD).
 * Returns 0, or -1 with errno.
 */
int umbu_folder_sync(int folder);
int umbu_folder_sync_at(int parent, const char *name);

#endif
