/* SPDX-License-Identifier: Apache-2.0 */
/* Choosing the lights, and the notices about the others. */
#include "bake/analysis/light_choice.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bake/analysis/light_frame.h"
#include "bake/analysis/sun_position.h"
#include "bake/base/print_text.h"
#include "base/memory.h"
#include "base/try.h"
#include "base/vec.h"

#define RAD_A_DEG 0.017453292519943295

/* The sun's angular diameter. */
#define SUN_DIAMETER_DEG 0.53

#define DEFAULT_AZIMUTH_DEG   135.0
#define DEFAULT_ELEVATION_DEG 45.0

#define MINUTES_A_DAY 1440.0

#define HALF_SPACE (90.0 * RAD_A_DEG) /* Half the angle of the cone of an area light */
#define LEVEL_MIN  1e-6 /* Least sine of the angle between a rectangle's direction and its axis */

/* Input and results of the choice. */
struct chooser {
    const struct umbs_scene_view *view;
    const struct umbb_options *options;
    int z_up;
    struct umbb_light_choice *choice;
    FILE *notices;
};

void umbb_light_choice_finish(struct umbb_light_choice *choice)
{
    free(choice->lights);
    free(choice->cones);
    free(choice->notices);
    memset(choice, 0, sizeof *choice);
}

/* Makes room for one more light, zeroed except for its extent, which is that of the options. If
 * they give none, a directional light gets the sun's. */
static enum umb_status add_light(struct chooser *c, enum umb_light_kind kind,
                                 struct umb_light_info **light, struct umb_error *error)
{
    struct umbb_light_choice *choice = c->choice;
    const struct umbb_light_requests *wanted = &c->options->lights;
    if (choice->count == UMB_LIGHTS_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT, "lights: more than %d, the most that an asset holds",
                        UMB_LIGHTS_MAX);
    }
    const size_t needed = choice->count + 1U;
    if (!umb__grow(NULL, &choice->lights, &choice->capacity, needed, sizeof *choice->lights) ||
        !umb__grow(NULL, &choice->cones, &choice->cone_capacity, needed, sizeof *choice->cones)) {
        return umb_fail(error, UMB_E_NO_MEMORY, "lights: memory for %zu refused", needed);
    }
    choice->cones[choice->count] = 0.0;
    *light = &choice->lights[choice->count++];
    memset(*light, 0, sizeof **light);
    (*light)->kind = kind;
    if (kind == UMB_LIGHT_DIRECTIONAL) {
        (*light)->extent = (wanted->has_size_deg ? wanted->size_deg : SUN_DIAMETER_DEG) * RAD_A_DEG;
    } else if (kind == UMB_LIGHT_SPOT || kind == UMB_LIGHT_POINT) {
        (*light)->extent = wanted->has_size_m ? wanted->size_m : 0.0;
    }
    return UMB_OK;
}

static enum umb_status choose_sun(struct chooser *c, double azimuth_deg, double elevation_deg,
                                  struct umb_error *error)
{
    struct umb_light_info *light;
    UMB__TRY(add_light(c, UMB_LIGHT_DIRECTIONAL, &light, error));
    if (c->options->lights.count > 1) {
        snprintf(light->name, sizeof light->name, "sun %g,%g", azimuth_deg, elevation_deg);
    } else {
        snprintf(light->name, sizeof light->name, "sun");
    }
    umbb_sun_direction(azimuth_deg, elevation_deg, c->z_up, light->direction);
    return UMB_OK;
}

/* Adds the suns of a path that are above the horizon, named by the mean solar time of the place. */
static enum umb_status choose_path(struct chooser *c, const struct umbb_sun_path *path,
                                   struct umb_error *error)
{
    const double midnight =
        umbb_days_from_2000(path->year, path->month, path->day) - path->longitude_deg / 360.0;
    const uint32_t before = c->choice->count;
    for (int step = 0; step * path->step_minutes < MINUTES_A_DAY; step++) {
        const double minutes = step * path->step_minutes;
        double towards[3];
        umbb_sun_towards(midnight + minutes / MINUTES_A_DAY, path->latitude_deg,
                         path->longitude_deg, towards);
        if (towards[2] <= 0.0) {
            continue;
        }
        struct umb_light_info *light;
        UMB__TRY(add_light(c, UMB_LIGHT_DIRECTIONAL, &light, error));
        const int whole = (int)minutes, seconds = (int)((minutes - whole) * 60.0);
        snprintf(light->name, sizeof light->name, "sun %04d-%02d-%02d %02d:%02d:%02d", path->year,
                 path->month, path->day, whole / 60, whole % 60, seconds);
        umbb_compass_direction(towards, c->z_up, light->direction);
    }
    if (c->choice->count == before) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--sun-path: at latitude %g on %04d-%02d-%02d no sun of every %g minutes "
                        "stands above the horizon",
                        path->latitude_deg, path->year, path->month, path->day, path->step_minutes);
    }
    return UMB_OK;
}

/* Adds a spot or point light of the command line. */
static enum umb_status choose_at(struct chooser *c, const struct umbb_light_request *request,
                                 struct umb_error *error)
{
    const int is_spot = request->kind == UMBB_REQUEST_SPOT;
    const double *p = request->position;
    struct umb_light_info *light;
    UMB__TRY(add_light(c, is_spot ? UMB_LIGHT_SPOT : UMB_LIGHT_POINT, &light, error));
    snprintf(light->name, sizeof light->name, "%s %g,%g,%g", is_spot ? "spot" : "point", p[0], p[1],
             p[2]);
    memcpy(light->position, p, sizeof light->position);
    if (is_spot) {
        c->choice->cones[c->choice->count - 1] = request->half_deg * RAD_A_DEG;
        memcpy(light->direction, request->direction, sizeof light->direction);
        if (!umbb_direction_normalise(light->direction)) {
            return umb_fail(error, UMB_E_ARGUMENT, "--spot: direction (%g, %g, %g) has no length",
                            request->direction[0], request->direction[1], request->direction[2]);
        }
    }
    return UMB_OK;
}

/* Finds the vector of a rectangle's first side: the given axis, or without one a level axis, made
 * perpendicular to the direction. Returns 0 if the axis is along the direction. */
static int rectangle_side(const double direction[3], const double *axis, int z_up, double width,
                          double side[3])
{
    const double up[3] = {0.0, z_up ? 0.0 : 1.0, z_up ? 1.0 : 0.0}, x[3] = {1.0, 0.0, 0.0};
    if (axis != NULL) {
        const double along = umb__dot(axis, direction);
        for (int k = 0; k < 3; k++) {
            side[k] = axis[k] - along * direction[k];
        }
    } else {
        umb__cross(up, direction, side);
        if (!(umb__length(side) > LEVEL_MIN)) { /* It looks straight up or down */
            return rectangle_side(direction, x, z_up, width, side);
        }
    }
    if (!(umb__length(side) > LEVEL_MIN * (axis != NULL ? umb__length(axis) : 1.0))) {
        return 0;
    }
    umbb_direction_normalise(side);
    umb__scale(width, side);
    return 1;
}

/* Adds an area light of the command line. */
static enum umb_status choose_area(struct chooser *c, const struct umbb_light_request *request,
                                   struct umb_error *error)
{
    const int is_disc = request->width == 0.0;
    const double *p = request->position, *d = request->direction, *axis = request->axis;
    const double *given = axis[0] != 0.0 || axis[1] != 0.0 || axis[2] != 0.0 ? axis : NULL;
    struct umb_light_info *light;
    UMB__TRY(add_light(c, is_disc ? UMB_LIGHT_DISC : UMB_LIGHT_RECTANGLE, &light, error));
    snprintf(light->name, sizeof light->name, "area %g,%g,%g", p[0], p[1], p[2]);
    memcpy(light->position, p, sizeof light->position);
    memcpy(light->direction, d, sizeof light->direction);
    light->extent = request->height;
    c->choice->cones[c->choice->count - 1] = HALF_SPACE;
    if (!umbb_direction_normalise(light->direction)) {
        return umb_fail(error, UMB_E_ARGUMENT, "--area: direction (%g, %g, %g) has no length", d[0],
                        d[1], d[2]);
    }
    if (!is_disc &&
        !rectangle_side(light->direction, given, c->z_up, request->width, light->side)) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--area: axis (%g, %g, %g) is along the direction (%g, %g, %g); give one "
                        "across it",
                        axis[0], axis[1], axis[2], d[0], d[1], d[2]);
    }
    return UMB_OK;
}

/* Takes the extent that the file gives a light. The options' size replaces that of suns, spots and
 * points. */
static void take_extent(struct chooser *c, const struct umbs_light *from,
                        struct umb_light_info *light)
{
    const size_t number = (size_t)(from - c->view->lights);
    const struct umbs_light_extent *extent =
        c->view->extents != NULL ? &c->view->extents[number] : NULL;
    const struct umbb_light_requests *wanted = &c->options->lights;
    const int is_area = light->kind == UMB_LIGHT_RECTANGLE || light->kind == UMB_LIGHT_DISC;
    const int is_replaced =
        light->kind == UMB_LIGHT_DIRECTIONAL ? wanted->has_size_deg : wanted->has_size_m;
    if (is_area) {
        c->choice->cones[c->choice->count - 1] = HALF_SPACE;
    }
    if (extent != NULL && extent->is_given && (is_area || !is_replaced)) {
        light->extent = extent->extent;
        memcpy(light->side, extent->side, sizeof light->side);
    }
}

static enum umb_status choose_of_file(struct chooser *c, const struct umbs_light *from,
                                      struct umb_error *error)
{
    struct umb_light_info *light;
    UMB__TRY(add_light(c, (enum umb_light_kind)from->kind, &light, error));
    snprintf(light->name, sizeof light->name, "%.*s", (int)(sizeof light->name - 1), from->name);
    if (light->kind != UMB_LIGHT_DIRECTIONAL) {
        memcpy(light->position, from->position, sizeof light->position);
        c->choice->cones[c->choice->count - 1] = from->outer_cone;
    }
    if (light->kind != UMB_LIGHT_POINT) {
        memcpy(light->direction, from->direction, sizeof light->direction);
        if (!umbb_direction_normalise(light->direction)) {
            char name[UMBB_ESCAPED_NAME_SIZE];
            umbb_escape(from->name, name, sizeof name);
            return umb_fail(error, UMB_E_BAD_SCENE,
                            "light '%s': direction (%g, %g, %g) has no length", name,
                            from->direction[0], from->direction[1], from->direction[2]);
        }
    }
    take_extent(c, from, light);
    return UMB_OK;
}

/* Adds the light that --light names: the first with that name. */
static enum umb_status choose_named(struct chooser *c, const char *wanted, struct umb_error *error)
{
    for (uint32_t i = 0; i < c->view->light_count; i++) {
        const struct umbs_light *from = &c->view->lights[i];
        if (strcmp(from->name, wanted) == 0) {
            return choose_of_file(c, from, error);
        }
    }
    return umb_fail(error, UMB_E_ARGUMENT, "--light: '%.64s' is none of the scene's %u lights",
                    wanted, c->view->light_count);
}

/* Adds the file's lights, or the default sun. */
static enum umb_status choose_default(struct chooser *c, struct umb_error *error)
{
    for (uint32_t i = 0; i < c->view->light_count; i++) {
        UMB__TRY(choose_of_file(c, &c->view->lights[i], error));
    }
    if (c->choice->count > 0) {
        return UMB_OK;
    }
    fprintf(c->notices, "the scene has no light: sun from azimuth %g, elevation %g\n",
            DEFAULT_AZIMUTH_DEG, DEFAULT_ELEVATION_DEG);
    return choose_sun(c, DEFAULT_AZIMUTH_DEG, DEFAULT_ELEVATION_DEG, error);
}

static enum umb_status choose_one(struct chooser *c, const struct umbb_light_request *request,
                                  struct umb_error *error)
{
    switch (request->kind) {
    case UMBB_REQUEST_SUN:
        return choose_sun(c, request->azimuth_deg, request->elevation_deg, error);
    case UMBB_REQUEST_PATH:
        return choose_path(c, &request->path, error);
    case UMBB_REQUEST_NAME:
        return choose_named(c, request->name, error);
    case UMBB_REQUEST_AREA:
        return choose_area(c, request, error);
    default:
        return choose_at(c, request, error);
    }
}

static enum umb_status choose_requested(struct chooser *c, struct umb_error *error)
{
    for (size_t i = 0; i < c->options->lights.count; i++) {
        UMB__TRY(choose_one(c, &c->options->lights.items[i], error));
    }
    return UMB_OK;
}

enum umb_status umbb_lights_choose(const struct umbs_scene_view *view,
                                   const struct umbb_options *options, int z_up,
                                   struct umbb_light_choice *choice, struct umb_error *error)
{
    memset(choice, 0, sizeof *choice);
    struct chooser c = {.view = view, .options = options, .z_up = z_up, .choice = choice};
    c.notices = open_memstream(&choice->notices, &choice->notice_bytes);
    if (c.notices == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "light: memory for notices refused");
    }
    enum umb_status status =
        options->lights.count > 0 ? choose_requested(&c, error) : choose_default(&c, error);
    const int short_of_memory = ferror(c.notices);
    /* glibc's fclose succeeds even if its last realloc failed; choice->notices is NULL then. */
    if ((fclose(c.notices) != 0 || short_of_memory || choice->notices == NULL) &&
        status == UMB_OK) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "light: memory for notices refused");
    }
    if (status != UMB_OK) {
        umbb_light_choice_finish(choice);
    }
    return status;
}
