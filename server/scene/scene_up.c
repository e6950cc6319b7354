/* SPDX-License-Identifier: Apache-2.0 */
/* Words for the evidence of a scene's up axis. */
#include "scene/scene.h"

const char *umbs_scene_up_reason(const struct umbs_scene_view *view)
{
    static const char *const words[UMBS_UP_EVIDENCE_COUNT] = {
        [UMBS_UP_NONE] = "nothing in the file tells it; --up y or --up z does",
        [UMBS_UP_FORMAT] = "the format says so",
        [UMBS_UP_COMMENT] = "a comment of the file names the axis",
        [UMBS_UP_PROGRAM] = "the program or data that the file names always has it",
        [UMBS_UP_MAP] = "the coordinates are those of a map",
        [UMBS_UP_GROUND] = "the scene is a ground that shows one side along it",
        [UMBS_UP_FLATS] = "the largest flat faces lie across it",
        [UMBS_UP_EXTENT] = "the scene is flat along it",
        [UMBS_UP_BASE] = "the scene stands on its zero",
        [UMBS_UP_OPENING] = "the scene is a body that is open at that lower end",
    };
    return words[view->up_evidence];
}

const char *umbs_scene_up_warning(const struct umbs_scene_view *view)
{
    return view->up_evidence != UMBS_UP_NONE ? NULL
           : view->z_up
               ? "up axis: nothing in the file tells whether y or z points up; z is taken: give "
                 "--up y if the scene lies on its side, --up z to confirm"
               : "up axis: nothing in the file tells whether y or z points up; y is taken: give "
                 "--up z if the scene lies on its side, --up y to confirm";
}
