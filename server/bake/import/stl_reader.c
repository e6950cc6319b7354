/* SPDX-License-Identifier: Apache-2.0 */
/*
 * STL, text and binary: triangles without materials. Text keeps doubles. Normals, names and the
 * attributes of binary facets are skipped.
 *
 * Source: 3D Systems, StereoLithography Interface Specification, 1989.
 */
#include <math.h>
#include <string.h>

#include "bake/import/face_builder.h"
#include "bake/import/import_job.h"
#include "base/try.h"

#define HEADER_BYTES 84 /* text, then the count of facets */
#define FACET_BYTES  50

/* 1 if the size of the file fits the count of facets of a binary STL. */
static int is_binary(const struct umbb_file *file)
{
    const size_t facets = file->size >= HEADER_BYTES ? file->size - HEADER_BYTES : 1;
    return facets % FACET_BYTES == 0 &&
           facets / FACET_BYTES == umbb_load_u32(file->bytes + HEADER_BYTES - 4);
}

static enum umb_status add_corner(struct umbb_faces *faces, const double position[3],
                                  struct umb_error *error)
{
    UMB__TRY(umbs_scene_add_vertex(faces->scene, position, NULL, error));
    return umbb_face_corner(faces, faces->scene->positions.count - 1, error);
}

/* Facets of a normal, three corners and two bytes. */
static enum umb_status read_binary(struct umbb_faces *faces, const struct umbb_file *file,
                                   struct umb_error *error)
{
    const char *end = file->bytes + file->size;
    for (const char *facet = file->bytes + HEADER_BYTES; facet < end; facet += FACET_BYTES) {
        for (size_t corner = 1; corner <= 3; corner++) {
            double position[3];
            for (size_t k = 0; k < 3; k++) {
                const struct umbb_scalar number = {'f', 4};
                position[k] = umbb_load_number(facet + 12 * corner + 4 * k, number, 0);
            }
            UMB__TRY(add_corner(faces, position, error));
        }
        UMB__TRY(umbb_face_end(faces, error));
    }
    return UMB_OK;
}

/* Words of a facet: "vertex" and three numbers for each corner, then "endfacet". A number that
 * cannot be read drops its facet. The word in its place stays in the text: it may be "endfacet". */
static enum umb_status read_text(struct umbb_faces *faces, const struct umbb_file *file,
                                 struct umb_error *error)
{
    struct umbb_cursor text = umbb_text_of(file), word;
    while (umbb_take_token(&text, &word)) {
        if (umbb_is_word(word, "vertex")) {
            double position[3];
            for (int k = 0; k < 3; k++) {
                struct umbb_cursor next = text;
                if (umbb_take_double(&next, &position[k])) {
                    text = next;
                } else {
                    position[k] = (double)NAN;
                }
            }
            UMB__TRY(add_corner(faces, position, error));
        } else if (umbb_is_word(word, "endfacet")) {
            UMB__TRY(umbb_face_end(faces, error));
        } else if (umbb_is_word(word, "solid") || umbb_is_word(word, "endsolid")) {
            const char *end = memchr(text.at, '\n', (size_t)(text.end - text.at));
            text.at = end != NULL ? end : text.end; /* the rest of the line is a name */
        }
    }
    return UMB_OK;
}

enum umb_status umbb_stl_read(struct umbb_import *job, struct umb_error *error)
{
    const int binary = is_binary(&job->file);
    struct umbb_faces faces = {.scene = &job->scene};
    if (!binary &&
        !(umbb_starts_with(umbb_text_of(&job->file), "solid") && umbb_is_text(&job->file))) {
        return UMBB_REFUSE(
            error,
            "the file is neither text STL nor binary STL whose size fits its count of "
            "facets (84 bytes and 50 for each facet; it has %zu)",
            job->file.size);
    }
    enum umb_status status =
        binary ? read_binary(&faces, &job->file, error) : read_text(&faces, &job->file, error);
    if (status == UMB_OK) {
        status = umbb_faces_end_scene(&faces, error);
    }
    umbb_faces_finish(&faces);
    return status;
}
