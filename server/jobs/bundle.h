/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_BUNDLE_H
#define UMBRAGE_SERVER_JOBS_BUNDLE_H
/*
 * A submission: a scene's files with their sizes and hashes, and the settings of its bake.
 *
 * Every field of a manifest is untrusted. Paths are relative, with plain components and no "." or
 * "..", so a bundle unpacked into an empty folder stays in that folder. Settings are those options
 * of umbrage-bake that decide an asset's content, by an allow-list. Each setting is one word of the
 * program's command line, so no value can become another option.
 *
 * The key is the SHA-256 of the files' list, the settings and the program's version. Equal keys
 * give equal assets.
 */
#include "jobs/job.h"

#define UMBJ_FILES_MAX      4096
#define UMBJ_PATH_MAX       512 /* bytes of a file's path */
#define UMBJ_PATH_DEPTH_MAX 16  /* components */
#define UMBJ_SETTINGS_MAX   512
#define UMBJ_VALUE_MAX      128 /* bytes of a setting's value */

struct umbj_bundle_file {
    const char *path; /* UTF-8 */
    uint64_t size;
    uint8_t sha256[UMBJ_HASH_BYTES];
};

struct umbj_setting {
    const char *name;  /* "resolution" */
    const char *value; /* "" for an option without one */
};

struct umbj_manifest {
    const char *scene; /* one of the files */
    const struct umbj_bundle_file *files;
    size_t file_count;
    const struct umbj_setting *settings; /* Settings in the order of a command line */
    size_t setting_count;
    int priority;
};

/*
 * Checks a manifest. max_bytes: limit for the sum of all files. Out: bytes: that sum.
 * Fails: E_ARGUMENT naming field, value and limit; E_TOO_LARGE (--max-bundle).
 */
UMB_CHECKED enum umb_status umbj_manifest_check(const struct umbj_manifest *manifest,
                                                uint64_t max_bytes, uint64_t *bytes,
                                                struct umb_error *error);

#define UMBJ_HEAD_BYTES 8

/* Refuses a file of the bundle that begins like a scene buffer (scene/scene_file.h). Only the
 * program's own commands may pass scene buffers to one another. In: head: UMBJ_HEAD_BYTES. Fails:
 * E_ARGUMENT. */
UMB_CHECKED enum umb_status umbj_bundle_check_head(size_t index, const char *path,
                                                   const uint8_t *head, struct umb_error *error);

/* Computes the key of a checked manifest. The order of the files does not matter. Fails:
 * E_NO_MEMORY. */
UMB_CHECKED enum umb_status umbj_manifest_key(const struct umbj_manifest *manifest,
                                              uint8_t key[UMBJ_HASH_BYTES],
                                              struct umb_error *error);

/* Fields of a manifest that the service needs. */
struct umbj_prepared {
    uint8_t key[UMBJ_HASH_BYTES];
    uint64_t bytes; /* Bytes of all files */
    char settings[UMBJ_SETTINGS_SIZE];
};

/*
 * Checks a manifest and makes its key and its settings text. Cost: milliseconds for thousands of
 * files.
 * Fails: as umbj_manifest_check, umbj_manifest_key and umbj_settings_text.
 */
UMB_CHECKED enum umb_status umbj_manifest_prepare(const struct umbj_manifest *manifest,
                                                  uint64_t max_bytes,
                                                  struct umbj_prepared *prepared,
                                                  struct umb_error *error);

/* Checks two fields in a row of the job table: settings in the form of umbj_settings_text, and the
 * name of the scene. Fails: E_ARGUMENT. */
UMB_CHECKED enum umb_status umbj_settings_check(const char *text, struct umb_error *error);
UMB_CHECKED enum umb_status umbj_scene_check(const char *scene, struct umb_error *error);

/* Writes the settings of a checked manifest as lines of --name=value. Fails: E_ARGUMENT (longer
 * than UMBJ_SETTINGS_SIZE). */
UMB_CHECKED enum umb_status umbj_settings_text(const struct umbj_manifest *manifest,
                                               char text[UMBJ_SETTINGS_SIZE],
                                               struct umb_error *error);

#endif
