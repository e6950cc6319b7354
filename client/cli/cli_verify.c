/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage verify FILE: opens the file with every check, then proves its id. A packed file is proven
 * by its page hashes. A mapped file has none: its content is packed again without output, which
 * computes the id from the bytes that a query reads. With --scene, umbrage-study is started
 * instead.
 */
#include "cli/shared/cli_common.h"

#include <stdio.h>
#include <string.h>
#include "tool/json.h"
#include "tool/tool_try.h"
#include "umbrage/region.h"

static const struct umbu_option OPTIONS[] = {
    {UMBC_TARGET_ROW(struct umbc_settings, "FILE", "the asset file")},
    {UMBU_JSON_ROW(struct umbc_settings)},
    {UMBU_QUIET_ROW(struct umbc_settings, "print nothing but errors")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage verify",
    .usage = "umbrage verify FILE [options]\n"
             "       umbrage verify FILE --scene SCENE [...]",
    .summary = "Checks every byte of an asset file and proves that its content has the id it\n"
               "claims. With --scene SCENE the shadows are compared with rays traced in the\n"
               "scene (starts umbrage-study, whose options are shown by `umbrage-study verify\n"
               "--help`).",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}},
};

/* Prints the verdict; info: NULL for a file that cannot be opened. Returns the exit code. */
static int report(const struct umbc_settings *settings, const struct umb_asset_info *info,
                  const struct umb_error *error)
{
    const bool good = error->status == UMB_OK;
    char id[UMB_ID_TEXT_SIZE];
    if (settings->json) {
        struct umbu_json json = umbu_json_open(stdout);
        if (info != NULL) {
            umbc_json_id(&json, "asset", info->id);
            umbu_json_text(&json, "encoding",
                           info->encoding == UMB_ENCODING_PACKED ? "packed" : "mapped");
        }
        umbu_json_bool(&json, "good", good);
        if (!good) {
            umbu_json_text(&json, "error", error->message);
        }
        umbu_json_close(&json);
    } else if (!settings->quiet && good) {
        umb_id_to_text(info->id, id);
        (void)printf("%s: good, asset %s\n", settings->target, id);
    }
    return good ? umbc_finish_stdout(0) : umbc_complain_file(settings->target, error);
}

/* Maps the file once, and opens and proves that mapping, so that the file cannot be replaced
 * between the two steps. */
static enum umb_status prove(const struct umb_file *file, struct umb_asset_info *info, bool *opened,
                             struct umb_error *error)
{
    struct umb_asset *asset;
    *opened = false;
    UMB__TRY(umb_asset_open_bytes(file->bytes, file->size, NULL, &asset, error));
    *opened = true;
    umb_asset_get_info(asset, info);
    const enum umb_status status =
        info->encoding == UMB_ENCODING_PACKED
            ? umb_packed_prove(file->bytes, file->size, NULL, umb_sha256_openssl(), error)
            : umb_asset_prove(asset, umb_sha256_openssl(), error);
    umb_asset_close(asset);
    return status;
}

static int verify_file(const struct umbc_settings *settings)
{
    struct umb_error error = {.status = UMB_OK};
    struct umb_asset_info info;
    struct umb_file file;
    bool opened = false;
    enum umb_status status = umb_file_open(settings->target, &file, &error);
    if (status == UMB_OK) {
        status = prove(&file, &info, &opened, &error);
        umb_file_close(&file);
    }
    error.status = status;
    return report(settings, opened ? &info : NULL, &error);
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
    struct umbu_parsed parsed;
    struct umbc_settings settings = {0};
    if (wants_scene(argc, argv)) {
        return umbc_start_program("verify --scene", "umbrage-study", "verify", argv + 1);
    }
    int code = umbu_start(&parsed, &COMMAND, argc, argv, &settings);
    return code >= 0 ? code : verify_file(&settings);
}
