/* SPDX-License-Identifier: Apache-2.0 */
/* The view of a camera; see map_view.h. */
#include "maps/map_view.h"

#include <math.h>
#include <string.h>
#include "base/vec.h"

enum umb_status umb__map_view_make(const struct umb_camera *camera, struct umb__map_view *view,
                                   struct umb_error *error)
{
    double right[3];
    const double along = umb__length(camera->forward);
    umb__cross(camera->forward, camera->up, right);
    const double across = umb__length(right);
    memset(view, 0, sizeof *view);
    if (!(along > 0.0) || !(across > 1e-9 * along * umb__length(camera->up))) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "camera: forward and up must be finite, of a length above 0, and 1e-9 rad "
                        "apart");
    }
    for (int i = 0; i < 3; i++) {
        view->eye[i] = camera->eye[i];
        view->forward[i] = camera->forward[i] / along;
        view->right[i] = right[i] / across;
    }
    umb__cross(view->right, view->forward, view->up);
    view->tan_y = tan(camera->fov_y / 2);
    view->tan_x = view->tan_y * camera->aspect;
    view->near_m = camera->near_m;
    view->far_m = camera->far_m;
    return UMB_OK;
}
