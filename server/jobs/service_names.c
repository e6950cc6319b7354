/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Names of assets that jobs replace.
 *
 * A name is a symbolic link in the folder of jobs' assets, which the store follows: NAME.umb for
 * callers without tokens, OWNER/NAME.umb for those with one. The job table decides, and the link
 * follows it: it is made anew by one rename when a job with the name is done, and at each start.
 */
#include "jobs/service_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/try.h"
#include "common/file_system.h"
#include "common/sha256.h"
#include "tool/output.h"

#define LINK_SIZE (UMBJ_NAME_MAX + sizeof ".tmp." + sizeof ".umb")

/* Name of an owner's folder: the owner's name if it may be a name in a store, else its hash. */
static void owner_folder(const char *owner, char folder[UMBJ_OWNER_SIZE])
{
    uint8_t hash[UMBJ_HASH_BYTES];
    char id[UMB_ID_TEXT_SIZE];
    struct umb_error error;
    if (umbj_name_check(owner, &error) == UMB_OK) {
        (void)snprintf(folder, UMBJ_OWNER_SIZE, "%s", owner);
        return;
    }
    umbs_sha256_bytes(owner, strlen(owner), hash);
    umb_id_to_text(hash, id);
    (void)snprintf(folder, UMBJ_OWNER_SIZE, "%.32s", id);
}

void umbj__store_name(const struct umbj_job *job, char name[UMBJ_STORE_NAME_SIZE])
{
    char folder[UMBJ_OWNER_SIZE] = "";
    if (job->owner[0] != '\0') {
        owner_folder(job->owner, folder);
    }
    (void)snprintf(name, UMBJ_STORE_NAME_SIZE, "%s%s%s", folder, folder[0] != '\0' ? "/" : "",
                   job->name);
}

/* Opens the folder of an owner's links, which is made if it is missing. Returns -1 with errno. */
static int open_links(const struct umbj_service *service, const char *owner)
{
    char folder[UMBJ_OWNER_SIZE];
    int assets = open(service->assets_path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (assets < 0 || owner[0] == '\0') {
        return assets;
    }
    owner_folder(owner, folder);
    const int made = mkdirat(assets, folder, 0755) == 0;
    if (made) {
        (void)umbu_folder_sync_at(AT_FDCWD, service->assets_path);
    }
    const int links = made || errno == EEXIST
                          ? openat(assets, folder, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC)
                          : -1;
    const int cause = errno;
    umbs_hang_up(&assets);
    errno = cause;
    return links;
}

/* Lets a name's link lead to an asset. Returns 0, or -1 with errno. */
static int make_link(int links, const struct umbj_job *job)
{
    char id[UMB_ID_TEXT_SIZE], target[sizeof "../" + UMB_ID_TEXT_SIZE + sizeof ".umb"];
    char temporary[LINK_SIZE], name[LINK_SIZE];
    umb_id_to_text(job->asset, id);
    (void)snprintf(target, sizeof target, "%s%s.umb", job->owner[0] != '\0' ? "../" : "", id);
    (void)snprintf(temporary, sizeof temporary, ".tmp.%s.umb", job->name);
    (void)snprintf(name, sizeof name, "%s.umb", job->name);
    (void)unlinkat(links, temporary, 0);
    return symlinkat(target, links, temporary) != 0 ||
                   renameat(links, temporary, links, name) != 0 || fsync(links) != 0
               ? -1
               : 0;
}

enum umb_status umbj__link_name(const struct umbj_service *service, const struct umbj_job *job,
                                struct umb_error *error)
{
    int links = open_links(service, job->owner);
    const int failed = links < 0 || make_link(links, job) != 0;
    const int cause = errno;
    umbs_hang_up(&links);
    return failed
               ? umb_fail_errno(error, UMB_E_IO, cause, "cannot make the name '%.80s'", job->name)
               : UMB_OK;
}

void umbj__unlink_name(const struct umbj_service *service, const struct umbj_job *job)
{
    char file[LINK_SIZE];
    int links = open_links(service, job->owner);
    (void)snprintf(file, sizeof file, "%s.umb", job->name);
    if (links >= 0) {
        (void)unlinkat(links, file, 0);
        umbs_hang_up(&links);
    }
}
