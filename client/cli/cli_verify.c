/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage verify FILE: opens with every check, then proves the identity. A packed file is proven
 * from its own page hashes. A mapped file carries none: its content is packed again into nothing,
 * which makes the identity from what a query would read. With --scene the program that has rays is
 * started instead.
 */
#include "cli_common.h"

#include <stdio.h>
#include <string.h>
#include "cli_json.h"
#include "umbrage/region.h"

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
    return umbc_complain_file(parsed->words[0], error);
}

/* Opens and proves one and the same map, so that the file cannot be another one in between. */
static enum umb_status prove(const struct umb_file *file, struct umb_asset_info *info, bool *opened,
                             struct umb_error *error)
{
    struct umb_asset *asset;
    enum umb_status status = umb_asset_open_bytes(file->bytes, file->size, NULL, &asset, error);
    *opened = status == UMB_OK;
    if (status != UMB_OK) {
        return status;
    }
    umb_asset_get_info(asset, info);
    status = info->encoding == UMB_ENCODING_PACKED
                 ? umb_packed_prove(file->bytes, file->size, NULL, umb_sha256_openssl(), error)
                 : umb_asset_prove(asset, umb_sha256_openssl(), error);
    umb_asset_close(asset);
    return status;
}

static int verify_file(const struct umbc_parsed *parsed)
{
    struct umb_error error = {.status = UMB_OK};
    struct umb_asset_info info;
    struct umb_file file;
    bool opened = false;
    enum umb_status status = umb_file_open(parsed->words[0], &file, &error);
    if (status == UMB_OK) {
        status = prove(&file, &info, &opened, &error);
        umb_file_close(&file);
    }
    error.status = status;
    if (!opened) {
        return fail_open(parsed, &error);
    }
    report(parsed, &info, &error);
    return status == UMB_OK ? umbc_finish_stdout(0) : umbc_complain_file(parsed->words[0], &error);
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
