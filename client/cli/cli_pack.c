/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage pack and unpack: one content, the other encoding. The identity is made again while
 * packing and must come out the same, so that a bad file or a bug never replaces a good one.
 */
#include "cli_common.h"

#include <stdio.h>
#include "tool/json.h"
#include "tool/output.h"
#include "cli_repack.h"

enum pack_option {
    OPTION_OUTPUT,
    OPTION_JSON,
    OPTION_QUIET,
    OPTION_COUNT,
};

static const struct umbc_option OPTIONS[OPTION_COUNT] = {
    [OPTION_OUTPUT] = {"output", "FILE", "where to write; replaced atomically; - is stdout; needed",
                       'o'},
    [OPTION_JSON] = {"json", NULL, "print one JSON object", 0},
    [OPTION_QUIET] = {"quiet", NULL, "print nothing but errors", 'q'},
};

static const struct umbc_command PACK = {
    .usage = "umbrage pack FILE -o OUT.umb [options]",
    .summary = "Writes the packed form of an asset, whatever form FILE has.",
    .options = OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 1,
    .max_words = 1,
};

static const struct umbc_command UNPACK = {
    .usage = "umbrage unpack FILE -o OUT.umbm [options]",
    .summary = "Writes the mapped form of an asset, which opens at once, whatever form FILE has.",
    .options = OPTIONS,
    .option_count = OPTION_COUNT,
    .min_words = 1,
    .max_words = 1,
};

static enum umb_status write_file(const struct umb_asset *asset, bool packed, const char *path,
                                  struct umb_error *error)
{
    struct umbu_output output;
    enum umb_status status = umbu_output_begin(path, UMBU_OUTPUT_COMMAND, &output, error);
    if (status != UMB_OK) {
        return status;
    }
    error->message[0] = '\0';
    struct umb_sink sink = umbu_output_sink(&output);
    status = packed ? umbc_repack(asset, &sink, error) : umb_mapped_write(asset, &sink, error);
    if (status == UMB_OK) {
        return umbu_output_commit(&output, error);
    }
    status = umbu_output_explain(&output, status, error);
    umbu_output_abandon(&output);
    return status;
}

static void report(const struct umbc_parsed *parsed, const struct umb_asset *asset,
                   const char *path)
{
    struct umb_asset_info info;
    char id[UMB_ID_TEXT_SIZE];
    umb_asset_get_info(asset, &info);
    umb_id_to_text(info.id, id);
    if (parsed->values[OPTION_JSON] != NULL) {
        struct umbu_json json = {.file = stdout};
        umbu_json_begin(&json, NULL, '{');
        umbu_json_text(&json, "asset", id);
        umbu_json_text(&json, "output", path);
        umbu_json_close(&json);
    } else if (parsed->values[OPTION_QUIET] == NULL) {
        (void)fprintf(stderr, "%s: asset %s\n", path, id);
    }
}

static int convert(const struct umbc_command *command, bool packed, int argc, char **argv)
{
    struct umbc_parsed parsed;
    struct umb_error error = {.status = UMB_OK};
    struct umb_asset *asset;
    int code = umbc_parse(command, argc, argv, &parsed);
    if (code >= 0) {
        return code;
    }
    const char *path = parsed.values[OPTION_OUTPUT];
    if (path == NULL) {
        return umbc_usage_error("%s: -o FILE is needed", argv[0]);
    }
    code = umbc_check_stdout(argv[0], path, parsed.values[OPTION_JSON] != NULL);
    if (code >= 0) {
        return code;
    }
    if (umb_asset_open_file(parsed.words[0], NULL, &asset, &error) != UMB_OK) {
        return umbc_complain_file(parsed.words[0], &error);
    }
    enum umb_status status = write_file(asset, packed, path, &error);
    if (status == UMB_OK) {
        report(&parsed, asset, path);
    }
    umb_asset_close(asset);
    return status == UMB_OK ? umbc_finish_stdout(0) : umbc_complain(&error);
}

int umbc_pack(int argc, char **argv)
{
    return convert(&PACK, true, argc, argv);
}

int umbc_unpack(int argc, char **argv)
{
    return convert(&UNPACK, false, argc, argv);
}
