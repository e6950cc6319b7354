/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage derive: shadow maps for a GPU, from a file or a daemon's asset. */
#include "cli_common.h"

#include <string.h>
#include "cli_derive_options.h"
#include "tool/json.h"
#include "tool/output.h"
#include "tool/clock.h"

/* The file that was made, wherever. */
struct made {
    const uint8_t *bytes; /* of one of the next two */
    size_t size;
    uint8_t asset[UMB_ID_BYTES];
    struct umb_derived *derived; /* made here, or NULL */
    uint8_t *received;           /* from a daemon, or NULL */
    bool bad_file;
};

static enum umb_status derive_here(const struct umbc_derive_options *options,
                                   const struct umb_derive_settings *settings, struct made *made,
                                   struct umb_error *error)
{
    struct umb_asset *asset;
    enum umb_status status = umb_asset_open_file(options->target, NULL, &asset, error);
    if (status != UMB_OK) {
        made->bad_file = true;
        return status;
    }
    status = umb_derive(asset, settings, NULL, &made->derived, error);
    umb_asset_close(asset);
    if (status == UMB_OK) {
        memcpy(made->asset, made->derived->asset_id, UMB_ID_BYTES);
        status = umb_derived_ktx2(made->derived, &made->bytes, &made->size, error);
    }
    return status;
}

static enum umb_status derive_there(const struct umbc_derive_options *options,
                                    const struct umb_derive_settings *settings, struct made *made,
                                    struct umb_error *error)
{
    struct umb_client *client;
    enum umb_status status = umbu_connect(&options->session, &client, error);
    if (status == UMB_OK) {
        status = umb_client_derive(client, options->target, settings, &made->received, &made->size,
                                   made->asset, NULL, error);
        made->bytes = made->received;
        umb_client_close(client);
    }
    return status;
}

static void tell(const struct umbc_derive_options *options, const struct made *made, double seconds)
{
    const struct umb_derive_settings *settings = &options->settings;
    const unsigned maps = settings->cascades.count > 0 ? settings->cascades.count : 1;
    char id[UMB_ID_TEXT_SIZE], size[32];
    umb_id_to_text(made->asset, id);
    if (options->json) {
        struct umbu_json json = {.file = stdout};
        umbu_json_begin(&json, NULL, '{');
        umbu_json_text(&json, "asset", id);
        umbu_json_integer(&json, "light", settings->light);
        umbu_json_integer(&json, "maps", maps);
        umbu_json_integer(&json, "width", settings->width);
        umbu_json_integer(&json, "height", settings->height);
        umbu_json_integer(&json, "bytes", made->size);
        umbu_json_number(&json, "seconds", seconds);
        umbu_json_close(&json);
    } else if (!options->quiet) {
        umbc_format_bytes(made->size, size);
        (void)fprintf(stderr, "%u map%s of %u x %u texels, %s, in %.3f s\n", maps,
                      maps == 1 ? "" : "s", settings->width, settings->height, size, seconds);
    }
}

int umbc_derive(int argc, char **argv)
{
    struct umbc_derive_options options;
    struct made made = {0};
    struct umb_error error = {.status = UMB_OK};
    const int code = umbc_derive_options_parse(&options, argc, argv);
    if (code >= 0) {
        return code;
    }
    struct umb_derive_settings settings = options.settings;
    settings.camera = &options.camera;
    const double from = umbu_clock_s();
    enum umb_status status = umbc_is_file(options.target)
                                 ? derive_here(&options, &settings, &made, &error)
                                 : derive_there(&options, &settings, &made, &error);
    const double seconds = umbu_clock_s() - from;
    if (status == UMB_OK) {
        status =
            umbu_output_replace(options.output, UMBU_OUTPUT_COMMAND, made.bytes, made.size, &error);
    }
    umb_derived_destroy(made.derived);
    umb_free(made.received);
    if (status != UMB_OK) {
        return made.bad_file ? umbc_complain_file(options.target, &error) : umbc_complain(&error);
    }
    tell(&options, &made, seconds);
    return umbc_finish_stdout(0);
}
