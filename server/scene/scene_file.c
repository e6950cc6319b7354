/* SPDX-License-Identifier: Apache-2.0 */
/* Scene files (scene_file.h). The bytes are read into private memory, because a mapped file could
 * change after the check. */
#define _DEFAULT_SOURCE /* MAP_ANONYMOUS */
#define XXH_INLINE_ALL
#include "scene/scene_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "base/bytes.h"
#include "base/try.h"
#include "common/file_system.h"
#include "common/private_folder.h"
#include "tool/output.h"

#define HEAD_BYTES ((size_t)16)

enum umb_status umbs_scene_save(const struct umbs_scene *scene, const char *path,
                                struct umb_error *error)
{
    uint8_t head[HEAD_BYTES];
    memcpy(head, UMBS_SCENE_FILE_MAGIC, UMBS_SCENE_FILE_MAGIC_BYTES);
    umb__store64(head + 8, XXH3_64bits(scene->map, scene->map_bytes));
    struct umbu_output file;
    UMB__TRY(umbu_output_begin(path, UMBU_OUTPUT_PRIVATE, &file, error));
    enum umb_status status = umbu_output_write(&file, head, sizeof head, error);
    if (status == UMB_OK) {
        status = umbu_output_write(&file, scene->map, scene->map_bytes, error);
    }
    if (status == UMB_OK) {
        status = umbu_output_commit(&file, error);
    }
    umbu_output_abandon(&file);
    return status;
}

/* Reads a scene from an open file, whose head was read. */
static enum umb_status load(int fd, const char *path, uint64_t checksum,
                            const struct umbs_import_options *options, struct umbs_scene *scene,
                            struct umb_error *error)
{
    struct stat facts;
    if (fstat(fd, &facts) != 0 || facts.st_size <= (off_t)HEAD_BYTES) {
        return umb_fail(error, UMB_E_BAD_SCENE, "scene file '%.200s' is cut", path);
    }
    const uint64_t size = (uint64_t)facts.st_size - HEAD_BYTES;
    if (options->max_memory_bytes > 0 && size > options->max_memory_bytes) {
        return umb_fail(error, UMB_E_LIMIT, "--memory: scene file '%.200s' has %llu MiB", path,
                        (unsigned long long)(size >> 20));
    }
    void *map =
        mmap(NULL, (size_t)size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (map == MAP_FAILED) {
        return umb_fail_errno(error, UMB_E_NO_MEMORY, errno, "memory for %llu MiB of scene refused",
                              (unsigned long long)(size >> 20));
    }
    scene->map = map;
    scene->map_bytes = (size_t)size;
    if (umbs_read_full(fd, map, (size_t)size) != (ssize_t)size ||
        XXH3_64bits(map, (size_t)size) != checksum) {
        return umb_fail(error, UMB_E_BAD_SCENE, "scene file '%.200s' is damaged", path);
    }
    return umbs__scene_check(scene, path, options, error);
}

/* Reads and checks the head, then the rest. */
static enum umb_status read_scene(int fd, const char *what, const char *path,
                                  const struct umbs_import_options *options,
                                  struct umbs_scene *scene, struct umb_error *error)
{
    uint8_t head[HEAD_BYTES];
    if (umbs_read_full(fd, head, sizeof head) != (ssize_t)sizeof head ||
        memcmp(head, UMBS_SCENE_FILE_MAGIC, UMBS_SCENE_FILE_MAGIC_BYTES) != 0) {
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "%s: '%.200s' is not a file that umbrage-bake import made", what, path);
    }
    return load(fd, path, umb__load64(head + 8), options, scene, error);
}

enum umb_status umbs_scene_load(const char *what, const char *path,
                                const struct umbs_import_options *options, struct umbs_scene **out,
                                struct umb_error *error)
{
    int fd;
    struct umb_error cause;
    *out = NULL;
    enum umb_status status = umbs_private_open(path, &fd, &cause);
    if (status != UMB_OK) {
        return umb_fail(error, status, "%s: %s", what, cause.message);
    }
    struct umbs_scene *scene = calloc(1, sizeof *scene);
    if (scene == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for a scene");
    }
    if (status == UMB_OK && options->shut_in != NULL) {
        status = options->shut_in(options->user, NULL, error);
    }
    if (status == UMB_OK) {
        status = read_scene(fd, what, path, options, scene, error);
    }
    (void)close(fd);
    if (status != UMB_OK) {
        umbs_scene_destroy(scene);
        return status;
    }
    *out = scene;
    return UMB_OK;
}
