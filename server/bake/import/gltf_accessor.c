/* SPDX-License-Identifier: Apache-2.0 */
/* Accessors of a glTF file (gltf.h). */
#include "bake/import/gltf.h"

#include <string.h>

#include "base/try.h"

#define STRIDE_MAX 65536
#define ZEROS_MAX  1048576U /* elements without bytes of the file */

/* The component of a componentType, if `kinds` has its kind. */
static int find_component(int64_t type, unsigned kinds, struct umbb_scalar *component)
{
    static const struct {
        int64_t type;
        unsigned kind;
        struct umbb_scalar component;
    } known[] = {
        {5120, UMBB_GLTF_SIGNED, {'i', 1}}, {5121, UMBB_GLTF_UNSIGNED, {'u', 1}},
        {5122, UMBB_GLTF_SIGNED, {'i', 2}}, {5123, UMBB_GLTF_UNSIGNED, {'u', 2}},
        {5125, UMBB_GLTF_UINT32, {'u', 4}}, {5126, UMBB_GLTF_FLOAT, {'f', 4}},
    };
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        if (known[i].type == type && (known[i].kind & kinds) != 0) {
            *component = known[i].component;
            return 1;
        }
    }
    return 0;
}

/* Finds the bytes of `count` elements. In: run: its component is set. place: JSON with bufferView
 * and byteOffset. Out: fits: 0 if the view is too short. */
static enum umb_status open_run(struct umbb_gltf *gltf, const json_t *place, uint32_t count,
                                uint32_t width, struct umbb_gltf_run *run, int *fits,
                                struct umb_error *error)
{
    struct umbb_gltf_view view;
    const int64_t offset = umbb_gltf_offset(place);
    const int64_t bytes = (int64_t)width * run->component.bytes;
    UMB__TRY(umbb_gltf_view(gltf, umbb_gltf_index(place, "bufferView"), &view, error));
    const int64_t stride = view.stride != UMBB_GLTF_NONE ? view.stride : bytes;
    /* Below 2^40 + 2^16 * 2^32. */
    *fits = stride >= 1 && stride <= STRIDE_MAX &&
            (uint64_t)(offset + stride * ((int64_t)count - 1) + bytes) <= view.size;
    run->bytes = *fits ? view.bytes + offset : NULL;
    run->stride = (size_t)stride;
    return UMB_OK;
}

/* One number of an element. */
static double load(const struct umbb_gltf_run *run, size_t element, uint32_t place)
{
    const char *at = run->bytes + element * run->stride + (size_t)place * run->component.bytes;
    return umbb_load_number(at, run->component, 0);
}

static uint32_t sparse_index(const struct umbb_gltf_accessor *accessor, uint32_t at)
{
    return (uint32_t)load(&accessor->sparse_index, at, 0);
}

/* One accessor of the JSON, and its use. */
struct source {
    const struct umbb_gltf_use *use;
    int64_t number;
};

static enum umb_status bad(struct source source, const char *fault, struct umb_error *error)
{
    return UMBB_REFUSE(error, "accessors[%lld] of %s %s", (long long)source.number,
                       source.use->name, fault);
}

/* Opens the replacements of an accessor. */
static enum umb_status open_sparse(struct umbb_gltf *gltf, struct source source,
                                   const json_t *sparse, struct umbb_gltf_accessor *accessor,
                                   struct umb_error *error)
{
    const json_t *indices = json_object_get(sparse, "indices");
    const int64_t count = umbb_gltf_index(sparse, "count");
    int fits, values_fit;
    if (count < 1 || count > accessor->count ||
        !find_component(umbb_gltf_index(indices, "componentType"),
                        UMBB_GLTF_UNSIGNED | UMBB_GLTF_UINT32, &accessor->sparse_index.component)) {
        return bad(source, "has a sparse count or sparse indices of a type that is not read",
                   error);
    }
    accessor->sparse_count = (uint32_t)count;
    accessor->sparse_value.component = accessor->elements.component;
    UMB__TRY(
        open_run(gltf, indices, accessor->sparse_count, 1, &accessor->sparse_index, &fits, error));
    UMB__TRY(open_run(gltf, json_object_get(sparse, "values"), accessor->sparse_count,
                      accessor->width, &accessor->sparse_value, &values_fit, error));
    if (!fits || !values_fit) {
        return bad(source, "has sparse elements outside of their buffer", error);
    }
    /* Once for each accessor: thousands of nodes may use the same one. */
    for (uint32_t i = 0; !gltf->accessors[source.number] && i < accessor->sparse_count; i++) {
        const uint32_t index = sparse_index(accessor, i);
        if (index >= accessor->count || (i > 0 && index <= sparse_index(accessor, i - 1))) {
            return bad(source, "has sparse indices that do not ascend below its count", error);
        }
    }
    gltf->accessors[source.number] = 1;
    return UMB_OK;
}

enum umb_status umbb_gltf_accessor(struct umbb_gltf *gltf, int64_t number,
                                   const struct umbb_gltf_use *use,
                                   struct umbb_gltf_accessor *accessor, struct umb_error *error)
{
    static const char *const widths[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
    const struct source source = {use, number};
    const json_t *json;
    UMB__TRY(umbb_gltf_item(gltf, "accessors", number, &json, error));
    const char *type = umbb_gltf_text(json, "type");
    const int64_t count = umbb_gltf_index(json, "count");
    const json_t *sparse = json_object_get(json, "sparse");
    *accessor = (struct umbb_gltf_accessor){
        .width = use->width, .is_normalized = json_is_true(json_object_get(json, "normalized"))};
    if (type == NULL || strcmp(type, widths[use->width - 1]) != 0 ||
        !find_component(umbb_gltf_index(json, "componentType"), use->kinds,
                        &accessor->elements.component)) {
        return UMBB_REFUSE(error, "accessors[%lld] of %s must be %s", (long long)number, use->name,
                           use->must);
    }
    if (count < 1 || count >= UINT32_MAX) {
        return bad(source, "has no count from 1 to 4294967294", error);
    }
    accessor->count = (uint32_t)count;
    if (json_object_get(json, "bufferView") != NULL) {
        int fits;
        UMB__TRY(
            open_run(gltf, json, accessor->count, use->width, &accessor->elements, &fits, error));
        if (!fits) {
            return bad(source, "lies outside of its buffer, or its byteStride is not in 1 to 65536",
                       error);
        }
    } else if (sparse == NULL || accessor->count > ZEROS_MAX) {
        return bad(source,
                   "has no bufferView, which is supported for sparse of up to 1048576 elements",
                   error);
    }
    return sparse != NULL ? open_sparse(gltf, source, sparse, accessor, error) : UMB_OK;
}

/* Position of an element among the replaced ones, or sparse_count. */
static uint32_t find_sparse(const struct umbb_gltf_accessor *accessor, uint32_t index)
{
    uint32_t low = 0, high = accessor->sparse_count;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (sparse_index(accessor, middle) < index) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low < accessor->sparse_count && sparse_index(accessor, low) == index
               ? low
               : accessor->sparse_count;
}

void umbb_gltf_get(const struct umbb_gltf_accessor *accessor, uint32_t index, double *numbers)
{
    const struct umbb_gltf_run *run = &accessor->elements;
    const uint32_t sparse = find_sparse(accessor, index);
    size_t element = index;
    if (sparse < accessor->sparse_count) {
        run = &accessor->sparse_value;
        element = sparse;
    }
    for (uint32_t i = 0; i < accessor->width; i++) {
        double value = run->bytes != NULL ? load(run, element, i) : 0.0;
        if (accessor->is_normalized && run->component.bytes < 4) {
            const uint32_t is_signed = run->component.kind == 'i';
            const double whole = (double)((1U << (8 * run->component.bytes - is_signed)) - 1U);
            value = value > -whole ? value / whole : -1.0;
        }
        numbers[i] = value;
    }
}
