/* SPDX-License-Identifier: Apache-2.0 */
/* Settings of a bake that a job may have, see bake_settings.h. */
#include "tool/bake_settings.h"

#include <string.h>

static enum umb_status collect(const struct umbu_option *option, const char *text, void *field,
                               struct umb_error *error)
{
    struct umbu_bake_settings *settings = field;
    if (settings->count == UMBU_BAKE_COLLECTED_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "--%s: '%.80s' is one too many; give at most %d",
                        option->name, text, UMBU_BAKE_COLLECTED_MAX);
    }
    if (text[0] == '\0') {
        return umbu_refuse(option, text, error);
    }
    settings->list[settings->count++] =
        (struct umb_job_setting){option->name, option->value != NULL ? text : ""};
    return UMB_OK;
}

#define COLLECTED UMBU_READ(collect, "a value")

const struct umbu_option UMBU_BAKE_SETTINGS[UMBU_BAKE_SETTING_COUNT] = {
    {UMBU_BAKE_RESOLUTION, COLLECTED}, {UMBU_BAKE_MAX_ERROR, COLLECTED},
    {UMBU_BAKE_SUN, COLLECTED},        {UMBU_BAKE_SUN_PATH, COLLECTED},
    {UMBU_BAKE_POINT, COLLECTED},      {UMBU_BAKE_SPOT, COLLECTED},
    {UMBU_BAKE_AREA, COLLECTED},       {UMBU_BAKE_LIGHT, COLLECTED},
    {UMBU_BAKE_LIGHT_SIZE, COLLECTED}, {UMBU_BAKE_UP, COLLECTED},
    {UMBU_BAKE_CLOSED, COLLECTED},     {UMBU_BAKE_EFFECT, COLLECTED},
    {UMBU_BAKE_STATIC, COLLECTED},     {UMBU_BAKE_DEPTH, COLLECTED},
    {UMBU_BAKE_VERIFY, COLLECTED},
};

enum umb_status umbu_scene_match(const char *asset, const uint8_t asset_hash[UMB_ID_BYTES],
                                 const char *scene, const uint8_t scene_hash[UMB_ID_BYTES],
                                 struct umb_error *error)
{
    char of_scene[UMB_ID_TEXT_SIZE], of_asset[UMB_ID_TEXT_SIZE];
    if (memcmp(scene_hash, asset_hash, UMB_ID_BYTES) == 0) {
        return UMB_OK;
    }
    umb_id_to_text(scene_hash, of_scene);
    umb_id_to_text(asset_hash, of_asset);
    return umb_fail(
        error, UMB_E_BAD_SCENE,
        "%.80s was not baked from %.80s: scene hash %.16s... in the asset, %.16s... of the "
        "scene (--force goes on)",
        asset, scene, of_asset, of_scene);
}

const struct umbu_option *umbu_bake_setting(const char *name)
{
    for (size_t i = 0; i < UMBU_BAKE_SETTING_COUNT; i++) {
        if (strcmp(UMBU_BAKE_SETTINGS[i].name, name) == 0) {
            return &UMBU_BAKE_SETTINGS[i];
        }
    }
    return NULL;
}
