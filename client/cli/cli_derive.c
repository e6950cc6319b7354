/* SPDX-License-Identifier: Apache-2.0 */
/* umbrage derive: shadow maps for a GPU, from a file or a daemon's asset. */
#include "cli_common.h"

#include <string.h>
#include "cli_derive_options.h"
#include "cli_json.h"
#include "cli_output.h"
#include "cli_progress.h"

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

static enum umb_status write_file(const char *path, const struct made *made,
                                  struct umb_error *error)
{
    struct umbc_output output;
    enum umb_status status = umbc_output_begin(path, &output, error);
    if (status != UMB_OK) {
        return status;
    }
    if (fwrite(made->bytes, 1, made->size, output.file) != made->size) {
        status = umb_fail(error, UMB_E_IO, "cannot write '%.200s'", path);
    } else {
        status = umbc_output_commit(&output, error);
    }
    umbc_output_abandon(&output);
    return status;
}

static void tell(const struct umbc_derive_options *options, const struct made *made, double seconds)
{
    const struct umb_derive_settings *settings = &options->settings;
    const unsigned maps = settings->cascades.count > 0 ? settings->cascades.count : 1;
    char id[UMB_ID_TEXT_SIZE], size[32];
    umb_id_to_text(made->asset, id);
    if (options->json) {
        struct umbc_json json = {.file = stdout};
        umbc_json_begin(&json, NULL, '{');
        umbc_json_text(&json, "asset", id);
        umbc_json_integer(&json, "light", settings->light);
        umbc_json_integer(&json, "maps", maps);
        umbc_json_integer(&json, "width", settings->width);
        umbc_json_integer(&json, "height", settings->height);
        umbc_json_integer(&json, "bytes", made->size);
        umbc_json_number(&json, "seconds", seconds);
        umbc_json_end(&json, '}');
        (void)putchar('\n');
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
    const double from = umbc_clock_s();
    enum umb_status status = umbc_is_file(options.target)
                                 ? derive_here(&options, &settings, &made, &error)
                                 : derive_there(&options, &settings, &made, &error);
    const double seconds = umbc_clock_s() - from;
    if (status == UMB_OK) {
        status = write_file(options.output, &made, &error);
    }
    umb_derived_destroy(made.derived);
    umb_free(made.received);
    if (status != UMB_OK) {
        return made.bad_file ? umbc_complain_file(options.target, &error) : umbc_complain(&error);
    }
    tell(&options, &made, seconds);
    return umbc_finish_stdout(0);
}
