/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage list: the assets of a daemon. */
#include "cli/shared/cli_common.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include "tool/json.h"

#define NAME_WIDTH 32U /* columns */

static const struct umbu_option OPTIONS[] = {
    {UMBU_JSON_ROW(struct umbc_settings)},
    {UMBU_QUIET_ROW(struct umbc_settings, "print only names")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage list",
    .usage = "umbrage list [options]",
    .summary = "Lists the assets of a daemon, by name.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBU_SESSION(struct umbc_settings, session)},
};

static void print_json(const struct umb_client_asset *assets, size_t count)
{
    struct umbu_json json = {.file = stdout};
    umbu_json_begin(&json, NULL, '{');
    umbu_json_begin(&json, "assets", '[');
    for (size_t i = 0; i < count; i++) {
        umbu_json_begin(&json, NULL, '{');
        umbu_json_text(&json, "name", assets[i].name);
        umbc_json_id(&json, "asset", assets[i].id);
        UMBU_JSON_COUNTS(&json, {"packed_bytes", assets[i].packed_bytes},
                         {"memory_bytes", assets[i].memory_bytes},
                         {"lights", assets[i].light_count});
        umbu_json_end(&json, '}');
    }
    umbu_json_close(&json);
}

static void print_table(const struct umb_client_asset *assets, size_t count, bool names_only)
{
    for (size_t i = 0; i < count; i++) {
        size_t length = strlen(assets[i].name);
        umbc_print_text(stdout, assets[i].name, length);
        if (names_only) {
            (void)putchar('\n');
            continue;
        }
        char id[UMB_ID_TEXT_SIZE];
        char packed[32];
        char memory[32];
        umb_id_to_text(assets[i].id, id);
        umbc_format_bytes(assets[i].packed_bytes, packed);
        umbc_format_bytes(assets[i].memory_bytes, memory);
        (void)printf("%*s %s  %12s packed %12s in memory %5" PRIu32 " lights\n",
                     length < NAME_WIDTH ? (int)(NAME_WIDTH - length) : 0, "", id, packed, memory,
                     assets[i].light_count);
    }
}

int umbc_list(int argc, char **argv)
{
    struct umbu_parsed parsed;
    struct umbc_settings settings = {0};
    struct umb_error error = {.status = UMB_OK};
    struct umb_client *client;
    struct umb_client_asset *assets;
    size_t count;
    int code = umbu_start(&parsed, &COMMAND, argc, argv, &settings);
    if (code >= 0) {
        return code;
    }
    if (umbu_connect(&settings.session, &client, &error) != UMB_OK) {
        return umbc_complain(&error);
    }
    enum umb_status status = umb_client_list_assets(client, &assets, &count, &error);
    if (status == UMB_OK) {
        if (settings.json) {
            print_json(assets, count);
        } else {
            print_table(assets, count, settings.quiet);
        }
        umb_free(assets);
    }
    umb_client_close(client);
    return status == UMB_OK ? umbc_finish_stdout(0) : umbc_complain(&error);
}
