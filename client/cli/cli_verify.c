/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage verify FILE: opens with every check, then proves the identity. A packed file is proven
 * from its own page hashes. A mapped file carries none: its content is packed again into nothing,
 * which makes the identity from what a query would read. With --scene the program that has rays is
 * started instead.
 */
#include "cli_common.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include "../rpc/rpc_sha256.h"
#include "cli_json.h"
#include "format/content.h"

enum verify_option {
    OPTION_JSON,
    OPTION_QUIET,
    OPTION_COUNT,
};

static const struct umbc_option OPTIONS[OPTION_COUNT] = {
    [OPTION_JSON] = {"json", NULL, "print one JSON object", 0},
    [OPTION_QUIET] = {"quiet", NULL, "print nothing but errors", 'q'},
};

static const struct umbc_command COMMAND = {
    .usage = "umbrage verify FILE [options]   or   umbrage verify FILE --scene SCENE [...]",
    .summary =
        "Checks every byte of an asset file and proves that its content has the id it claims.\n"
        "With --scene SCENE the shadows are compared with rays traced in the scene\n"
        "(starts umbrage-study, whose options are shown by `umbrage-study verify --help`).",
    .options = OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 1,
    .max_words = 1,
};

static enum umb_status drop_bytes(void *user, const void *bytes, size_t count)
{
    (void)user;
    (void)bytes;
    (void)count;
    return UMB_OK;
}

static enum umb_status prove_mapped(const struct umb_asset *asset, const uint8_t id[UMB_ID_BYTES],
                                    struct umb_error *error)
{
    const struct umb_sink sink = {.write = drop_bytes, .user = NULL};
    struct umb_octree octree;
    struct umb_content content;
    uint8_t made[UMB_ID_BYTES];
    enum umb_status status = umb_asset_export(asset, &octree, &content, error);
    if (status != UMB_OK) {
        return status;
    }
    status = umb_pack_write(&content, &octree, &umb__client_sha256, &sink, made, error);
    umb_octree_finish(&octree);
    if (status == UMB_OK && memcmp(made, id, sizeof made) != 0) {
        status =
            umb_fail(error, UMB_E_CORRUPT, "the file's content does not have the id it claims");
    }
    return status;
}

static enum umb_status prove_packed(const char *path, struct umb_error *error)
{
    struct stat info;
    int file = open(path, O_RDONLY | O_CLOEXEC);
    if (file < 0 || fstat(file, &info) != 0) {
        int code = errno;
        if (file >= 0) {
            (void)close(file);
        }
        return umb_fail_errno(error, UMB_E_NO_INPUT, code, "cannot open '%.200s'", path);
    }
    size_t size = (size_t)info.st_size;
    void *bytes = size == 0 ? MAP_FAILED : mmap(NULL, size, PROT_READ, MAP_PRIVATE, file, 0);
    int code = errno;
    (void)close(file);
    if (bytes == MAP_FAILED) {
        return umb_fail_errno(error, UMB_E_IO, size == 0 ? EINVAL : code, "cannot map '%.200s'",
                              path);
    }
    enum umb_status status = umb_pack_prove(bytes, size, 1, &umb__client_sha256, error);
    (void)munmap(bytes, size);
    return status;
}

static void report(const struct umbc_parsed *parsed, const struct umb_asset_info *info,
                   const struct umb_error *error)
{
    char id[UMB_ID_TEXT_SIZE];
    umb_id_to_text(info->id, id);
    if (parsed->values[OPTION_JSON] != NULL) {
        struct umbc_json json = {.file = stdout};
        umbc_json_begin(&json, NULL, '{');
        umbc_json_text(&json, "asset", id);
        umbc_json_text(&json, "encoding",
                       info->encoding == UMB_ENCODING_PACKED ? "packed" : "mapped");
        umbc_json_bool(&json, "good", error->status == UMB_OK);
        if (error->status != UMB_OK) {
            umbc_json_text(&json, "error", error->message);
        }
        umbc_json_end(&json, '}');
        (void)putchar('\n');
    } else if (parsed->values[OPTION_QUIET] == NULL && error->status == UMB_OK) {
        (void)printf("%s: good, asset %s\n", parsed->words[0], id);
    }
}

/* Prints an object also for a file that cannot be opened: --json always gives one. */
static int fail_open(const struct umbc_parsed *parsed, const struct umb_error *error)
{
    if (parsed->values[OPTION_JSON] != NULL) {
        struct umbc_json json = {.file = stdout};
        umbc_json_begin(&json, NULL, '{');
        umbc_json_bool(&json, "good", false);
        umbc_json_text(&json, "error", error->message);
        umbc_json_end(&json, '}');
        (void)putchar('\n');
    }
    return umbc_complain(error);
}

static int verify_file(const struct umbc_parsed *parsed)
{
    const struct umb_open_options options = {.trust = UMB_TRUST_NOTHING};
    struct umb_error error = {.status = UMB_OK};
    struct umb_asset *asset;
    struct umb_asset_info info;
    if (umb_asset_open_file(parsed->words[0], &options, &asset, &error) != UMB_OK) {
        return fail_open(parsed, &error);
    }
    umb_asset_get_info(asset, &info);
    enum umb_status status = info.encoding == UMB_ENCODING_PACKED
                                 ? prove_packed(parsed->words[0], &error)
                                 : prove_mapped(asset, info.id, &error);
    error.status = status;
    report(parsed, &info, &error);
    umb_asset_close(asset);
    return status == UMB_OK ? umbc_finish_stdout(0) : umbc_complain(&error);
}

static bool wants_scene(int argc, char **argv)
{
    for (int i = 1; i < argc && strcmp(argv[i], "--") != 0; i++) {
        if (strcmp(argv[i], "--scene") == 0 || strncmp(argv[i], "--scene=", 8) == 0) {
            return true;
        }
    }
    return false;
}

int umbc_verify(int argc, char **argv)
{
    static const char *const prefix[] = {"verify", NULL};
    struct umbc_parsed parsed;
    if (wants_scene(argc, argv)) {
        return umbc_start_program("verify --scene", "umbrage-study", prefix, argv + 1);
    }
    int code = umbc_parse(&COMMAND, argc, argv, &parsed);
    return code >= 0 ? code : verify_file(&parsed);
}
