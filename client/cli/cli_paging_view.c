/* SPDX-License-Identifier: Apache-2.0 */
/* See cli_paging_view.h. */
#include "cli_paging_view.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "cli/shared/cli_common.h"
#include "tool/base.h"
#include "tool/keys.h"
#include "tool/tool_try.h"

#define DEFAULT_FOV_DEG 60.0
#define PI              3.14159265358979323846

bool umbc_parse_box(const char *text, struct umb_partial_view *view)
{
    double v[6];
    if (!umbu_read_numbers(text, 6, v)) {
        return false;
    }
    for (unsigned i = 0; i < 3; i++) {
        view->box.min[i] = fmin(v[i], v[i + 3]);
        view->box.max[i] = fmax(v[i], v[i + 3]);
    }
    view->has_box = 1;
    return true;
}

bool umbc_parse_camera(const char *text, double aspect, char up, struct umb_partial_view *view)
{
    double eye[3], target[3], fov = DEFAULT_FOV_DEG, far = 0;
    bool has_eye = false, has_target = false, has_fov = false, has_far = false;
    const struct umbu_key keys[] = {
        {"eye", &has_eye, eye, 3, HUGE_VAL},
        {"target", &has_target, target, 3, HUGE_VAL},
        {"fov", &has_fov, &fov, 1, 180},
        {"far", &has_far, &far, 1, HUGE_VAL},
    };
    if (umbu_read_keys("--camera", text, "eye target fov far", keys, sizeof keys / sizeof keys[0],
                       NULL) != UMB_OK ||
        !has_eye || !has_target || !(fov > 0 && fov < 180) || !(far >= 0)) {
        return false;
    }
    view->has_camera = 1;
    view->camera.fov_y = fov * PI / 180;
    view->camera.aspect = aspect;
    view->camera.far_m = far;
    for (unsigned i = 0; i < 3; i++) {
        view->camera.eye[i] = eye[i];
        view->camera.forward[i] = target[i] - eye[i];
        view->camera.up[i] = (i == 1 && up == 'y') || (i == 2 && up == 'z') ? 1 : 0;
    }
    return true;
}

enum umb_status umbc_read_path(const char *path, double aspect, char up,
                               const struct umb_partial_view *base, struct umbc_views *views,
                               struct umb_error *error)
{
    size_t number = 0, capacity = 0;
    char line[512];
    FILE *file;
    *views = (struct umbc_views){0};
    enum umb_status status = UMB_OK;
    UMB__TRY(umbc_open_input(path, &file, error));
    while (status == UMB_OK && fgets(line, sizeof line, file)) {
        number++;
        line[strcspn(line, "\r\n")] = '\0';
        if (line[0] == '\0' || line[0] == '#') {
            continue;
        }
        if (!umb__grow(NULL, &views->list, &capacity, views->count + 1, sizeof *views->list)) {
            status = umb_fail(error, UMB_E_NO_MEMORY, "path: out of memory");
            break;
        }
        views->list[views->count] = *base;
        if (!umbc_parse_camera(line, aspect, up, &views->list[views->count++])) {
            status = umb_fail(error, UMB_E_FORMAT, "'%.200s', line %zu: no camera", path, number);
        }
    }
    (void)fclose(file);
    if (status == UMB_OK && views->count == 0) {
        status = umb_fail(error, UMB_E_FORMAT, "'%.200s': no camera in it", path);
    }
    if (status != UMB_OK) {
        umbc_views_finish(views);
    }
    return status;
}

void umbc_views_finish(struct umbc_views *views)
{
    free(views->list);
    *views = (struct umbc_views){0};
}

bool umbc_project(const struct umb_partial_view *view, const double point[3], size_t width,
                  size_t height, size_t pixel[2])
{
    const double *f = view->camera.forward, *u = view->camera.up;
    const double right[3] = {f[1] * u[2] - f[2] * u[1], f[2] * u[0] - f[0] * u[2],
                             f[0] * u[1] - f[1] * u[0]};
    const double top[3] = {right[1] * f[2] - right[2] * f[1], right[2] * f[0] - right[0] * f[2],
                           right[0] * f[1] - right[1] * f[0]};
    double along = 0, across = 0, upwards = 0, f2 = 0, r2 = 0, t2 = 0;
    for (unsigned i = 0; i < 3; i++) {
        const double d = point[i] - view->camera.eye[i];
        along += d * f[i];
        across += d * right[i];
        upwards += d * top[i];
        f2 += f[i] * f[i];
        r2 += right[i] * right[i];
        t2 += top[i] * top[i];
    }
    const double half = tan(view->camera.fov_y / 2), depth = along / sqrt(f2);
    const double x = across / sqrt(r2) / (depth * half * view->camera.aspect);
    const double y = upwards / sqrt(t2) / (depth * half);
    if (!(along > 0) || !(fabs(x) < 1) || !(fabs(y) < 1)) {
        return false;
    }
    pixel[0] = (size_t)((x + 1) / 2 * (double)width);
    pixel[1] = (size_t)((1 - y) / 2 * (double)height);
    return pixel[0] < width && pixel[1] < height;
}
