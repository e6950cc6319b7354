/* SPDX-License-Identifier: Apache-2.0 */
/* Choosing one light; the words for what is left out. */
#include "bake/analysis/light_choice.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bake/analysis/light_frame.h"
#include "bake/print_text.h"

/* The sun's angular diameter, 0.53 degrees, in radians. */
#define SUN_DIAMETER_RAD 0.00925024503556995

#define DEFAULT_AZIMUTH_DEG   135.0
#define DEFAULT_ELEVATION_DEG 45.0

static void choose_sun(double azimuth_deg, double elevation_deg, int z_up,
                       struct umb_light_info *light)
{
    snprintf(light->name, sizeof light->name, "sun");
    light->kind = UMB_LIGHT_DIRECTIONAL;
    light->extent = SUN_DIAMETER_RAD;
    umbb_sun_direction(azimuth_deg, elevation_deg, z_up, light->direction);
}

static const char *kind_text(uint32_t kind)
{
    return kind == UMB_LIGHT_DIRECTIONAL ? "directional"
           : kind == UMB_LIGHT_SPOT      ? "spot"
                                         : "point";
}

static enum umb_status choose_of_file(const struct umbs_light *from, struct umb_light_info *light,
                                      struct umb_error *error)
{
    snprintf(light->name, sizeof light->name, "%.*s", (int)(sizeof light->name - 1), from->name);
    light->kind = UMB_LIGHT_DIRECTIONAL;
    memcpy(light->direction, from->direction, sizeof light->direction);
    if (!umbb_direction_normalise(light->direction)) {
        char name[UMBB_ESCAPED_NAME_SIZE];
        umbb_escape(from->name, name, sizeof name);
        return umb_fail(error, UMB_E_BAD_SCENE, "light '%s': direction (%g, %g, %g) has no length",
                        name, from->direction[0], from->direction[1], from->direction[2]);
    }
    return UMB_OK;
}

/* The light that --light names; the first of that name. */
static enum umb_status choose_named(const struct umbs_scene_view *view, const char *wanted,
                                    struct umb_light_info *light, struct umb_error *error)
{
    for (uint32_t i = 0; i < view->light_count; i++) {
        const struct umbs_light *from = &view->lights[i];
        if (strcmp(from->name, wanted) != 0) {
            continue;
        }
        if (from->kind != UMB_LIGHT_DIRECTIONAL) {
            return umb_fail(error, UMB_E_UNSUPPORTED,
                            "--light: '%.64s' is a %s light; this version bakes directional ones",
                            wanted, kind_text(from->kind));
        }
        return choose_of_file(from, light, error);
    }
    return umb_fail(error, UMB_E_ARGUMENT, "--light: '%.64s' is none of the scene's %u lights",
                    wanted, view->light_count);
}

/* The file's first directional light or the default sun; notices say what was passed over. */
static enum umb_status choose_default(const struct umbs_scene_view *view, int z_up,
                                      struct umb_light_info *light, FILE *notices,
                                      struct umb_error *error)
{
    int found = 0;
    for (uint32_t i = 0; i < view->light_count; i++) {
        const struct umbs_light *from = &view->lights[i];
        char name[UMBB_ESCAPED_NAME_SIZE];
        umbb_escape(from->name, name, sizeof name);
        if (from->kind != UMB_LIGHT_DIRECTIONAL) {
            fprintf(notices, "light '%s' is a %s light: left out, not supported yet\n", name,
                    kind_text(from->kind));
        } else if (found) {
            fprintf(notices, "light '%s' is left out: one light is baked; choose with --light\n",
                    name);
        } else {
            found = 1;
            const enum umb_status status = choose_of_file(from, light, error);
            if (status != UMB_OK) {
                return status;
            }
        }
    }
    if (!found) {
        fprintf(notices, "the scene has no directional light: sun from azimuth %g, elevation %g\n",
                DEFAULT_AZIMUTH_DEG, DEFAULT_ELEVATION_DEG);
        choose_sun(DEFAULT_AZIMUTH_DEG, DEFAULT_ELEVATION_DEG, z_up, light);
    }
    return UMB_OK;
}

enum umb_status umbb_light_choose(const struct umbs_scene_view *view,
                                  const struct umbb_options *options, int z_up,
                                  struct umb_light_info *light, char **notices,
                                  size_t *notice_bytes, struct umb_error *error)
{
    memset(light, 0, sizeof *light);
    *notices = NULL;
    *notice_bytes = 0;
    light->frustum_count = 1;
    if (options->has_sun) {
        choose_sun(options->sun_azimuth_deg, options->sun_elevation_deg, z_up, light);
        return UMB_OK;
    }
    if (options->light != NULL) {
        return choose_named(view, options->light, light, error);
    }
    FILE *text = open_memstream(notices, notice_bytes);
    if (text == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "light: memory for notices refused");
    }
    enum umb_status status = choose_default(view, z_up, light, text, error);
    const int short_of_memory = ferror(text);
    /* glibc closes well even if the last realloc fails, and then there is no text. */
    if ((fclose(text) != 0 || short_of_memory || *notices == NULL) && status == UMB_OK) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "light: memory for notices refused");
    }
    if (status != UMB_OK) {
        free(*notices);
        *notices = NULL;
        *notice_bytes = 0;
    }
    return status;
}
