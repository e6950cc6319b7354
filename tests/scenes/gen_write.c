/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Writers of the generated scenes. OBJ and PLY hold every millimetre exactly (x / 1000.0 in doubles
 * is the double nearest to the three printed decimals). GLB holds float32 relative to the box's
 * centre, which the node's translation gives in full: glTF 2.0 specification, sections 3.6 and 4;
 * KHR_lights_punctual for the sun.
 */
#include "gen.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

enum {
    CHUNK_JSON = 0x4e4f534a,
    CHUNK_BIN = 0x004e4942,
    JSON_SIZE = 4096,
};

static void put_u32(FILE *file, uint32_t value)
{
    const unsigned char bytes[4] = {(unsigned char)value, (unsigned char)(value >> 8),
                                    (unsigned char)(value >> 16), (unsigned char)(value >> 24)};
    (void)fwrite(bytes, 1, sizeof bytes, file); /* failures are found by ferror at the end */
}

static void put_f64(FILE *file, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_u32(file, (uint32_t)bits);
    put_u32(file, (uint32_t)(bits >> 32));
}

static void put_f32(FILE *file, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_u32(file, bits);
}

/* Millimetres as metres with three decimals, without rounding. */
static void metres_text(int64_t mm, char text[32])
{
    int64_t size = mm < 0 ? -mm : mm;
    (void)snprintf(text, 32, "%s%" PRId64 ".%03d", mm < 0 ? "-" : "", size / 1000,
                   (int)(size % 1000));
}

/* Returns how many times the mesh is placed, and corner k of vertex i of a placement. */
static size_t times(const struct gen_mesh *mesh)
{
    return mesh->place_count > 0 ? mesh->place_count : 1;
}

static int32_t coordinate(const struct gen_mesh *mesh, size_t place, size_t i, int k)
{
    return mesh->vertices[i][k] + (mesh->place_count > 0 ? mesh->places[place][k] : 0);
}

static void write_obj(FILE *file, const struct gen_mesh *mesh)
{
    char text[3][32];
    (void)fprintf(file, "# umbrage scenegen, metres, z up\n");
    const size_t vertices = mesh->vertex_count, triangles = mesh->triangle_count;
    for (size_t i = 0; i < times(mesh) * vertices; i++) {
        for (int k = 0; k < 3; k++) {
            metres_text(coordinate(mesh, i / vertices, i % vertices, k), text[k]);
        }
        (void)fprintf(file, "v %s %s %s\n", text[0], text[1], text[2]);
    }
    for (size_t i = 0; i < times(mesh) * triangles; i++) {
        const uint32_t *t = mesh->triangles[i % triangles];
        const uint64_t first = i / triangles * (uint64_t)vertices + 1;
        (void)fprintf(file, "f %" PRIu64 " %" PRIu64 " %" PRIu64 "\n", t[0] + first, t[1] + first,
                      t[2] + first);
    }
}

static void write_ply(FILE *file, const struct gen_mesh *mesh)
{
    const size_t vertices = mesh->vertex_count, triangles = mesh->triangle_count;
    (void)fprintf(file,
                  "ply\nformat binary_little_endian 1.0\ncomment umbrage scenegen, metres, z up\n"
                  "element vertex %zu\nproperty double x\nproperty double y\nproperty double z\n"
                  "element face %zu\nproperty list uchar uint vertex_indices\nend_header\n",
                  times(mesh) * vertices, times(mesh) * triangles);
    for (size_t i = 0; i < times(mesh) * vertices; i++) {
        for (int k = 0; k < 3; k++) {
            put_f64(file, coordinate(mesh, i / vertices, i % vertices, k) / 1000.0);
        }
    }
    for (size_t i = 0; i < times(mesh) * triangles; i++) {
        (void)fputc(3, file);
        for (int k = 0; k < 3; k++) {
            put_u32(file, mesh->triangles[i % triangles][k] + (uint32_t)(i / triangles * vertices));
        }
    }
}

/* Box of the mesh in millimetres, and the middle that GLB positions are relative to. */
struct extent {
    int32_t low[3], high[3], centre[3];
};

static struct extent extent_of(const struct gen_mesh *mesh)
{
    struct extent extent = {.low = {INT32_MAX, INT32_MAX, INT32_MAX},
                            .high = {INT32_MIN, INT32_MIN, INT32_MIN}};
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        for (int k = 0; k < 3; k++) {
            int32_t value = mesh->vertices[i][k];
            extent.low[k] = value < extent.low[k] ? value : extent.low[k];
            extent.high[k] = value > extent.high[k] ? value : extent.high[k];
        }
    }
    for (int k = 0; k < 3; k++) {
        extent.centre[k] = (int32_t)(((int64_t)extent.low[k] + extent.high[k]) / 2);
    }
    return extent;
}

/* A z-up point in millimetres as glTF's y-up metres about the centre: x, z, -y. */
static void glb_position(const struct extent *extent, const int32_t point[3], float out[3])
{
    int64_t d[3];
    for (int k = 0; k < 3; k++) {
        d[k] = (int64_t)point[k] - extent->centre[k];
    }
    out[0] = (float)((double)d[0] / 1000.0);
    out[1] = (float)((double)d[2] / 1000.0);
    out[2] = (float)((double)-d[1] / 1000.0);
}

/* Returns the words of the file about the extensions that it uses; "" if it uses none. */
static void glb_extensions(int many, int light, char used[512])
{
    used[0] = '\0';
    if (many || light) {
        (void)snprintf(used, 512, "\"extensionsUsed\":[%s%s%s],%s%s",
                       many ? "\"EXT_mesh_gpu_instancing\"" : "", many && light ? "," : "",
                       light ? "\"KHR_lights_punctual\"" : "",
                       many ? "\"extensionsRequired\":[\"EXT_mesh_gpu_instancing\"]," : "",
                       light ? "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":"
                               "\"directional\",\"name\":\"sun\",\"intensity\":100000,"
                               "\"color\":[1,1,1]}]}},"
                             : "");
    }
}

/* Returns the length, padded with spaces to a multiple of four, or 0 if it does not fit. */
static uint32_t glb_json(const struct gen_mesh *mesh, const struct extent *extent, int light,
                         char json[JSON_SIZE])
{
    float a[3], b[3];
    char move[3][32], used[512], places_view[128] = "", places_accessor[128] = "";
    const int many = mesh->place_count > 0;
    const size_t mesh_bytes = 12 * (mesh->vertex_count + mesh->triangle_count);
    if (many) {
        (void)snprintf(places_view, sizeof places_view,
                       ",{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu}", mesh_bytes,
                       12 * mesh->place_count);
        (void)snprintf(places_accessor, sizeof places_accessor,
                       ",{\"bufferView\":2,\"componentType\":5126,\"count\":%zu,"
                       "\"type\":\"VEC3\"}",
                       mesh->place_count);
    }
    glb_extensions(many, light, used);
    glb_position(extent, extent->low, a);
    glb_position(extent, extent->high, b);
    metres_text(extent->centre[0], move[0]);
    metres_text(extent->centre[2], move[1]);
    metres_text(-(int64_t)extent->centre[1], move[2]);
    /* The rotation turns -z into the direction (-0.5, -sqrt(1/2), -0.5). */
    int n = snprintf(
        json, JSON_SIZE,
        "{\"asset\":{\"version\":\"2.0\",\"generator\":\"umbrage scenegen\"},%s"
        "\"scene\":0,\"scenes\":[{\"nodes\":[0%s]}],"
        "\"nodes\":[{\"mesh\":0,\"name\":\"scene\",\"translation\":[%s,%s,%s]%s}%s],"
        "\"materials\":[{\"name\":\"stone\",\"doubleSided\":true}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1,"
        "\"material\":0}]}],"
        "\"buffers\":[{\"byteLength\":%zu}],\"bufferViews\":["
        "{\"buffer\":0,\"byteOffset\":0,\"byteLength\":%zu,\"target\":34962},"
        "{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu,\"target\":34963}%s],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":%zu,\"type\":\"VEC3\","
        "\"min\":[%.9g,%.9g,%.9g],\"max\":[%.9g,%.9g,%.9g]},"
        "{\"bufferView\":1,\"componentType\":5125,\"count\":%zu,\"type\":\"SCALAR\"}%s]}",
        used, light ? ",1" : "", move[0], move[1], move[2],
        many ? ",\"extensions\":{\"EXT_mesh_gpu_instancing\":{\"attributes\":{"
               "\"TRANSLATION\":2}}}"
             : "",
        light ? ",{\"name\":\"sun\",\"rotation\":[-0.353553390593274,0.353553390593274,"
                "0.146446609406726,0.853553390593274],"
                "\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}}"
              : "",
        mesh_bytes + 12 * mesh->place_count, 12 * mesh->vertex_count, 12 * mesh->vertex_count,
        12 * mesh->triangle_count, places_view, mesh->vertex_count, (double)a[0], (double)a[1],
        (double)b[2], (double)b[0], (double)b[1], (double)a[2], 3 * mesh->triangle_count,
        places_accessor);
    if (n <= 0 || n > JSON_SIZE - 4) {
        return 0;
    }
    while (n % 4 != 0) {
        json[n++] = ' ';
    }
    return (uint32_t)n;
}

static int write_glb(FILE *file, const struct gen_mesh *mesh, int light)
{
    char json[JSON_SIZE];
    struct extent extent = extent_of(mesh);
    uint32_t json_bytes = glb_json(mesh, &extent, light, json);
    uint64_t bin_bytes =
        12 * ((uint64_t)mesh->vertex_count + mesh->triangle_count + mesh->place_count);
    uint64_t total = 12 + 8 + json_bytes + 8 + bin_bytes;
    if (json_bytes == 0 || total > UINT32_MAX) {
        return 0;
    }
    put_u32(file, 0x46546c67); /* "glTF" */
    put_u32(file, 2);
    put_u32(file, (uint32_t)total);
    put_u32(file, json_bytes);
    put_u32(file, CHUNK_JSON);
    (void)fwrite(json, 1, json_bytes, file);
    put_u32(file, (uint32_t)bin_bytes);
    put_u32(file, CHUNK_BIN);
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        float position[3];
        glb_position(&extent, mesh->vertices[i], position);
        for (int k = 0; k < 3; k++) {
            put_f32(file, position[k]);
        }
    }
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        for (int k = 0; k < 3; k++) {
            put_u32(file, mesh->triangles[i][k]);
        }
    }
    const struct extent origin = {.centre = {0, 0, 0}};
    for (size_t i = 0; i < mesh->place_count; i++) {
        float place[3];
        glb_position(&origin, mesh->places[i], place);
        for (int k = 0; k < 3; k++) {
            put_f32(file, place[k]);
        }
    }
    return 1;
}

int gen_write(FILE *file, const struct gen_mesh *mesh, enum gen_format format, int light)
{
    int good = !mesh->failed;
    if (good && format == GEN_FORMAT_GLB) {
        good = write_glb(file, mesh, light);
    } else if (good && format == GEN_FORMAT_OBJ) {
        write_obj(file, mesh);
    } else if (good) {
        write_ply(file, mesh);
    }
    return good && fflush(file) == 0 && !ferror(file);
}
