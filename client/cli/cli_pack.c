/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage pack and unpack: the same content in the other encoding. The id is computed again while
 * packing and must stay the same, so that a damaged file or a bug never replaces a good file.
 */
#include "cli/shared/cli_common.h"

#include <stdio.h>
#include "tool/json.h"
#include "tool/output.h"
#include "umbrage/region.h"

struct pack_settings {
    const char *target, *output;
    bool json, quiet;
};

static const struct umbu_option OPTIONS[] = {
    {UMBC_TARGET_ROW(struct pack_settings, "FILE", "the asset file")},
    {"output", "FILE", "file to write, replaced as a whole; - is stdout", UMBU_TEXT,
     UMBU_AT(struct pack_settings, output), .needed = true, .letter = 'o'},
    {UMBU_JSON_ROW(struct pack_settings), .excludes = "output=-"},
    {UMBU_QUIET_ROW(struct pack_settings, "print nothing but errors")},
};

static const struct umbu_command PACK = {
    .name = "umbrage pack",
    .usage = "umbrage pack FILE -o OUT.umb [options]",
    .summary = "Writes the packed form of an asset, whatever form FILE has.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}},
};

static const struct umbu_command UNPACK = {
    .name = "umbrage unpack",
    .usage = "umbrage unpack FILE -o OUT.umbm [options]",
    .summary = "Writes the mapped form of an asset, which opens at once, whatever form FILE has.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}},
};

/* An asset and the encoding to write. */
struct content {
    struct umb_asset *asset;
    enum umb_encoding encoding;
};

static enum umb_status write_content(void *user, const struct umb_sink *sink,
                                     struct umb_error *error)
{
    const struct content *content = user;
    return umb_asset_write(content->asset, content->encoding, umb_sha256_openssl(), sink, error);
}

static void report(const struct pack_settings *settings, const struct umb_asset *asset)
{
    struct umb_asset_info info;
    umb_asset_get_info(asset, &info);
    if (settings->json) {
        struct umbu_json json = umbu_json_open(stdout);
        umbc_json_id(&json, "asset", info.id);
        umbu_json_text(&json, "output", settings->output);
        umbu_json_close(&json);
    } else if (!settings->quiet) {
        char id[UMB_ID_TEXT_SIZE];
        umb_id_to_text(info.id, id);
        (void)fprintf(stderr, "%s: asset %s\n", settings->output, id);
    }
}

static int convert(const struct umbu_command *command, enum umb_encoding encoding, int argc,
                   char **argv)
{
    struct umbu_parsed parsed;
    struct pack_settings settings = {0};
    struct umb_error error = {.status = UMB_OK};
    struct content content = {.encoding = encoding};
    int code = umbu_start(&parsed, command, argc, argv, &settings);
    if (code >= 0) {
        return code;
    }
    if (umb_asset_open_file(settings.target, NULL, &content.asset, &error) != UMB_OK) {
        return umbc_complain_file(settings.target, &error);
    }
    const enum umb_status status =
        umbu_output_write_by(settings.output, UMBU_OUTPUT_COMMAND, write_content, &content, &error);
    if (status == UMB_OK) {
        report(&settings, content.asset);
    }
    umb_asset_close(content.asset);
    return status == UMB_OK ? umbc_finish_stdout(0) : umbc_complain(&error);
}

int umbc_pack(int argc, char **argv)
{
    return convert(&PACK, UMB_ENCODING_PACKED, argc, argv);
}

int umbc_unpack(int argc, char **argv)
{
    return convert(&UNPACK, UMB_ENCODING_MAPPED, argc, argv);
}
