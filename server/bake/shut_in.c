/* SPDX-License-Identifier: Apache-2.0 */
/* From options to rules, see shut_in.h. */
#include "bake/shut_in.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define PLACES_MAX 5

/* The folder of a file: free() it. */
static char *folder_of(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash != NULL ? strndup(path, (size_t)(slash - path) + 1) : strdup(".");
}

struct places {
    struct umbb_path_rule rules[PLACES_MAX];
    size_t count;
    char *owned[2]; /* folders of the scene and of the output */
};

static void add_place(struct places *places, const char *path, enum umbb_path_use use)
{
    if (path != NULL) {
        places->rules[places->count++] = (struct umbb_path_rule){path, use};
    }
}

/* Out: 1, or 0 if out of memory. */
static int collect(const struct umbb_options *o, struct places *places)
{
    const int writes_tiles = o->task == UMBB_TASK_TILE;
    add_place(places, o->scene, UMBB_PATH_READ); /* the scene may be a link to a file elsewhere */
    if (!o->scene_buffer) {
        places->owned[0] = folder_of(o->scene);
        add_place(places, places->owned[0], UMBB_PATH_READ);
    }
    if (!o->plan && !writes_tiles) {
        places->owned[1] = folder_of(o->output);
        add_place(places, places->owned[1], UMBB_PATH_WRITE);
    }
    if (!o->plan) {
        const char *tiles = writes_tiles ? o->output : o->cache;
        if (tiles != NULL) {
            (void)!mkdir(tiles, 0777); /* a failure shows when the folder is opened */
        }
        add_place(places, tiles, UMBB_PATH_WRITE);
        add_place(places, o->from, UMBB_PATH_WRITE); /* damaged tiles are removed */
    }
    return (o->scene_buffer || places->owned[0] != NULL) &&
           (o->plan || writes_tiles || places->owned[1] != NULL);
}

enum umb_status umbb_shut_in_paths(const struct umbb_options *options,
                                   struct umbb_bake_sandbox *sandbox, struct umb_error *error)
{
    struct places places = {.count = 0};
    *sandbox = (struct umbb_bake_sandbox){.mode = options->sandbox};
    if (sandbox->mode == UMBB_SANDBOX_OFF) {
        return UMB_OK;
    }
    enum umb_status status =
        umbb_bake_sandbox_limits(options->memory_bytes, options->threads, error);
    if (status == UMB_OK) {
        status = collect(options, &places)
                     ? umbb_bake_sandbox_paths(sandbox, places.rules, places.count, error)
                     : umb_fail(error, UMB_E_NO_MEMORY, "out of memory");
    }
    free(places.owned[0]);
    free(places.owned[1]);
    return status;
}

enum umb_status umbb_shut_in_calls(void *user, const struct umbs_importer *importer,
                                   struct umb_error *error)
{
    return umbb_bake_sandbox_calls(user, importer != NULL ? importer->process : 0,
                                   importer != NULL ? importer->files : -1, error);
}

void umbb_shut_in_notice(const struct umbb_bake_sandbox *sandbox)
{
    if (strcmp(umbb_bake_sandbox_level(sandbox), "reduced") == 0) {
        fprintf(
            stderr,
            "umbrage-bake: notice: sandbox: a layer is missing (Landlock %s, system call filter "
            "%s); see umbrage-bake doctor\n",
            sandbox->landlock_abi > 0 ? "yes" : "no", sandbox->seccomp ? "yes" : "no");
    }
}
