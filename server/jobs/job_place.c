/* SPDX-License-Identifier: Apache-2.0 */
/* See job_place.h. */
#include "jobs/job_place.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/open_status.h"
#include "base/try.h"
#include "tool/clock.h"
#include "common/private_folder.h"
#include "jobs/folder.h"

void umbj_place_init(struct umbj_place *place)
{
    *place = (struct umbj_place){.folder = {.fd = -1}, .table = {.fd = -1}};
}

/* Refuses a folder on a network file system. */
static enum umb_status check_reach(const char *folder, struct umb_error *error)
{
    const char *name = "";
    const int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) {
        return umb_fail_errno(error, umb__open_status(errno), errno,
                              "--jobs-db: the folder '%.150s'", folder);
    }
    const enum umbs_reach reach = umbs_file_system(fd, &name);
    (void)close(fd);
    if (reach != UMBS_REACH_NETWORK) {
        return UMB_OK;
    }
    return umb_fail(error, UMB_E_ARGUMENT,
                    "--jobs-db: '%.150s' is on %s, where the table's journal (SQLite's WAL) is not "
                    "safe; give --jobs-db FILE on a local disk, --jobs DIR may stay where it is",
                    folder, name);
}

/* Checks the place of a table outside DIR: other users cannot change its folder, and DIR has no
 * table of its own. */
static enum umb_status check_apart(const char *jobs, const char *table, const char *folder,
                                   struct umb_error *error)
{
    struct umb_error cause;
    char *resolved = NULL;
    char old[4300];
    enum umb_status status = umbs_private_folder(folder, &resolved, &cause);
    free(resolved);
    if (status != UMB_OK) {
        return umb_fail(error, status, "--jobs-db: %s", cause.message);
    }
    (void)snprintf(old, sizeof old, "%s/jobs.db", jobs);
    if (access(table, F_OK) != 0 && access(old, F_OK) == 0) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--jobs-db: there is no '%.150s' yet, but a table in '%.150s': move "
                        "jobs.db, and jobs.db-wal if it is there, to keep its jobs",
                        table, jobs);
    }
    return UMB_OK;
}

enum umb_status umbj_place_check(const char *folder, const char *table, struct umbj_place *place,
                                 struct umb_error *error)
{
    char around[4200];
    umbj_place_init(place);
    const int length =
        table != NULL ? snprintf(place->table_path, sizeof place->table_path, "%s", table)
                      : snprintf(place->table_path, sizeof place->table_path, "%s/jobs.db", folder);
    if (length < 0 || (size_t)length >= sizeof place->table_path) {
        return umb_fail(error, UMB_E_LIMIT, "--jobs-db: a path of %d bytes is too long", length);
    }
    (void)umbj_folder_above(place->table_path, around, sizeof around);
    UMB__TRY(check_reach(around, error));
    return table != NULL ? check_apart(folder, table, around, error) : UMB_OK;
}

/* Takes the lock FILE.lock or FOLDER/lock. In: option: name of the option that gave the file or
 * folder. */
static enum umb_status take(const char *guarded, const char *ending, const char *option,
                            struct umbs_owner_lock *lock, struct umb_error *error)
{
    char path[UMBS_LOCK_PATH_MAX + 8];
    struct umb_error cause;
    (void)snprintf(path, sizeof path, "%s%s", guarded, ending);
    const enum umb_status status = umbs_owner_lock_take(path, lock, &cause);
    return status == UMB_OK ? UMB_OK : umb_fail(error, status, "%s: %s", option, cause.message);
}

enum umb_status umbj_place_take(const char *folder, const char *table, struct umbj_place *place,
                                struct umb_error *error)
{
    UMB__TRY(umbj_place_check(folder, table, place, error));
    UMB__TRY(take(folder, "/lock", "--jobs", &place->folder, error));
    const enum umb_status status =
        table != NULL ? take(table, ".lock", "--jobs-db", &place->table, error) : UMB_OK;
    if (status != UMB_OK) {
        umbj_place_release(place);
    }
    return status;
}

enum umb_status umbj_place_beat(struct umbj_place *place, struct umb_error *error)
{
    const int64_t now = umbu_clock_ms();
    if (now < place->beat_at_ms) {
        return UMB_OK;
    }
    place->beat_at_ms = now + UMBS_BEAT_MS;
    UMB__TRY(umbs_owner_lock_beat(&place->folder, error));
    return umbs_owner_lock_beat(&place->table, error);
}

void umbj_place_release(struct umbj_place *place)
{
    umbs_owner_lock_release(&place->table);
    umbs_owner_lock_release(&place->folder);
}
