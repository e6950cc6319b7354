/* SPDX-License-Identifier: Apache-2.0 */
/*
 * glTF, GLB and STL through Assimp 5.2.5. Only formats and content that passed umbb_import_detect
 * come here, under a name of our own, so Assimp can choose no other importer.
 *
 * Flags: ValidateDataStructure and Triangulate only. Without the first, broken files crash later
 * steps; the other steps (merging, flattening, normals) are not needed, or done by our own code.
 * The validator refuses lights, cameras and animations whose node's name is not unique, which valid
 * glTF may have. They do not affect the meshes, so they are set aside while it runs.
 */
#include <assimp/GltfMaterial.h>
#include <assimp/cimport.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bake/import/assimp_files.h"
#include "bake/import/assimp_nodes.h"
#include "bake/import/assimp_textures.h"
#include "bake/import/face_builder.h"
#include "bake/import/gltf_guard.h"
#include "bake/import/gltf_texcoords.h"
#include "base/try.h"
#include "common/clean_text.h"

/* Parts of a scene that are hidden from the validator. */
struct aside {
    struct aiLight **lights;
    struct aiCamera **cameras;
    struct aiAnimation **animations;
    unsigned light_count, camera_count, animation_count;
};

static void step_aside(struct aiScene *scene, struct aside *aside)
{
    *aside = (struct aside){
        .lights = scene->mLights,
        .cameras = scene->mCameras,
        .animations = scene->mAnimations,
        .light_count = scene->mNumLights,
        .camera_count = scene->mNumCameras,
        .animation_count = scene->mNumAnimations,
    };
    scene->mLights = NULL;
    scene->mCameras = NULL;
    scene->mAnimations = NULL;
    scene->mNumLights = scene->mNumCameras = scene->mNumAnimations = 0;
}

static void step_back(struct aiScene *scene, const struct aside *aside)
{
    scene->mLights = aside->lights;
    scene->mCameras = aside->cameras;
    scene->mAnimations = aside->animations;
    scene->mNumLights = aside->light_count;
    scene->mNumCameras = aside->camera_count;
    scene->mNumAnimations = aside->animation_count;
}

/* Failure with Assimp's message, and the file that it missed. */
static enum umb_status assimp_failed(const struct umbb_assimp_files *files, struct umb_error *error)
{
    char text[160];
    const char *words = aiGetErrorString();
    umbs_text_clean(text, sizeof(text), words, strlen(words));
    if (strstr(text, "bad_alloc") != NULL || strstr(text, "bad allocation") != NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory");
    }
    if (strstr(text, "No suitable reader") != NULL) {
        return umb_fail(error, UMB_E_BAD_SCENE, "the file is of an unknown version of its format");
    }
    return umb_fail(error, UMB_E_BAD_SCENE, "%s%s%s",
                    text[0] != '\0' ? text : "Assimp gives no reason",
                    files->refused[0] != '\0' ? "; " : "", files->refused);
}

static enum umb_status load(struct umbb_assimp_files *files, const char *name, struct aiScene **out,
                            struct umb_error *error)
{
    /* Static, because a failed validation deletes the scene and leaves these parts behind: they
     * stay reachable until the process ends, which is soon. */
    static struct aside aside;
    *out = NULL;
    /* aiScene is const for shared use; this one has a single owner. */
    struct aiScene *scene = (struct aiScene *)(uintptr_t)aiImportFileEx(name, 0, &files->io);
    if (scene == NULL) {
        return assimp_failed(files, error);
    }
    if (scene->mNumMeshes == 0 || scene->mRootNode == NULL) {
        aiReleaseImport(scene);
        return umb_fail(error, UMB_E_BAD_SCENE, "no meshes, so no triangles");
    }
    step_aside(scene, &aside);
    const struct aiScene *checked =
        aiApplyPostProcessing(scene, aiProcess_ValidateDataStructure | aiProcess_Triangulate);
    if (checked == NULL) {
        return assimp_failed(files, error);
    }
    step_back(scene, &aside);
    *out = scene;
    return UMB_OK;
}

static double get_float(const struct aiMaterial *source, const char *key, unsigned type,
                        unsigned index, double otherwise)
{
    ai_real value = 0;
    unsigned count = 1;
    if (aiGetMaterialFloatArray(source, key, type, index, &value, &count) != aiReturn_SUCCESS ||
        count < 1 || !isfinite(value)) {
        return otherwise;
    }
    return (double)value;
}

static double clamp_unit(double value)
{
    return value > 0.0 ? (value < 1.0 ? value : 1.0) : 0.0;
}

/* State of a scene's conversion. */
struct conversion {
    const struct aiScene *scene;
    struct umbb_faces faces;
    struct umbb_texture_table textures;
    struct umbb_uv_mapping *mappings; /* [mNumMaterials] */
    struct umbb_gltf_sets sets;
    enum umbb_kind kind;
    int has_materials;
    /* Number of meshes whose material has a texture, but which lack its coordinates. */
    unsigned bare;
};

/* Applies KHR_texture_transform.texCoord, which overrides the texture's own TEXCOORD set. */
static void obey_texture_transform(struct conversion *c, const struct umbs_material *material,
                                   const struct aiString *name, struct umbb_uv_mapping *mapping)
{
    const uint32_t set = umbb_gltf_set_of(&c->sets, name->data, name->length);
    if (set == UMBB_SET_UNKNOWN) {
        umbs_scene_warn(c->faces.scene,
                        "material '%s': its name does not tell which set of coordinates "
                        "KHR_texture_transform gives its texture; TEXCOORD_%u is taken",
                        material->name, mapping->set);
    } else if (set != UMBB_SET_UNSAID) {
        mapping->set = set;
    }
}

static enum umb_status add_material(struct conversion *c, unsigned number, struct umb_error *error)
{
    struct umbs_scene_builder *builder = c->faces.scene;
    const struct aiMaterial *source = c->scene->mMaterials[number];
    struct umbs_material material = umbs_material_opaque();
    struct aiString name = {0}, text = {0};
    if (aiGetMaterialString(source, AI_MATKEY_NAME, &name) == aiReturn_SUCCESS) {
        umbs_text_clean(material.name, sizeof(material.name), name.data, sizeof(name.data));
    }
    if (aiGetMaterialString(source, AI_MATKEY_GLTF_ALPHAMODE, &text) == aiReturn_SUCCESS) {
        material.alpha_mode = strcmp(text.data, "MASK") == 0    ? UMBS_ALPHA_MASK
                              : strcmp(text.data, "BLEND") == 0 ? UMBS_ALPHA_BLEND
                                                                : UMBS_ALPHA_OPAQUE;
    }
    double cutoff = get_float(source, AI_MATKEY_GLTF_ALPHACUTOFF, 0.5);
    if (cutoff > 1.0 && material.alpha_mode == UMBS_ALPHA_MASK) {
        umbs_scene_warn(builder, "material '%s': alphaCutoff %g is taken as 1", material.name,
                        cutoff);
    }
    material.alpha_cutoff = (float)clamp_unit(cutoff);
    int sided = 0;
    unsigned count = 1;
    if (aiGetMaterialIntegerArray(source, AI_MATKEY_TWOSIDED, &sided, &count) == aiReturn_SUCCESS) {
        material.double_sided = sided != 0;
    }
    struct aiColor4D color = {1, 1, 1, 1};
    if (aiGetMaterialColor(source, AI_MATKEY_BASE_COLOR, &color) == aiReturn_SUCCESS) {
        material.base_alpha = (float)clamp_unit((double)color.a);
    }
    material.transmission =
        (float)clamp_unit(get_float(source, AI_MATKEY_TRANSMISSION_FACTOR, 0.0));
    if (material.transmission > 0.0F &&
        aiGetMaterialTextureCount(source, aiTextureType_TRANSMISSION) > 0) {
        umbs_scene_warn(builder,
                        "material '%s': the texture of its transmission is not read; the factor "
                        "counts all over",
                        material.name);
    }
    UMB__TRY(umbb_assimp_texture(c->scene, source, &c->textures, &material, &c->mappings[number],
                                 error));
    if (material.texture != UMBS_NO_INDEX) {
        obey_texture_transform(c, &material, &name, &c->mappings[number]);
    }
    return umbs_scene_add_material(builder, &material, error);
}

/* Source of a mesh's texture coordinates. In: material: its number or UMBS_NO_INDEX. */
static const struct umbb_uv_mapping *mapping_of(const struct conversion *c, uint32_t material)
{
    static const struct umbb_uv_mapping plain = {0};
    return material != UMBS_NO_INDEX ? &c->mappings[material] : &plain;
}

static int has_coordinates(const struct umbb_uv_mapping *mapping, const struct aiMesh *mesh)
{
    return mapping->set < AI_MAX_NUMBER_OF_TEXTURECOORDS &&
           mesh->mTextureCoords[mapping->set] != NULL;
}

/* The material of a mesh. UMBS_NO_INDEX: it has none, or the mesh lacks coordinates for its
 * texture; such a mesh is opaque. */
static uint32_t choose_material(struct conversion *c, const struct aiMesh *mesh)
{
    const struct umbs_material *materials = c->faces.scene->materials.data;
    const uint32_t number = mesh->mMaterialIndex;
    if (!c->has_materials || number >= c->faces.scene->materials.count) {
        return UMBS_NO_INDEX;
    }
    if (materials[number].texture != UMBS_NO_INDEX &&
        !has_coordinates(mapping_of(c, number), mesh)) {
        c->bare++;
        return UMBS_NO_INDEX;
    }
    return number;
}

static enum umb_status add_vertices(const struct conversion *c, const struct aiMesh *mesh,
                                    uint32_t material, struct umb_error *error)
{
    const struct umbb_uv_mapping *mapping = mapping_of(c, material);
    const int has_uvs = has_coordinates(mapping, mesh);
    for (unsigned i = 0; i < mesh->mNumVertices; i++) {
        const struct aiVector3D *at = &mesh->mVertices[i];
        const double position[3] = {(double)at->x, (double)at->y, (double)at->z};
        float uv[2];
        umbb_assimp_uv(mapping, mesh, i, uv);
        UMB__TRY(umbs_scene_add_vertex(c->faces.scene, position, has_uvs ? uv : NULL, error));
    }
    return UMB_OK;
}

/* Appends the triangles of a mesh; its vertices start at `first`. Points and lines cast nothing. */
static enum umb_status add_faces(struct umbb_faces *faces, const struct aiMesh *mesh,
                                 uint32_t first, struct umb_error *error)
{
    for (unsigned i = 0; i < mesh->mNumFaces; i++) {
        const struct aiFace *face = &mesh->mFaces[i];
        for (unsigned k = 0; face->mNumIndices >= 3 && k < face->mNumIndices; k++) {
            unsigned index = face->mIndices[k];
            UMB__TRY(umbb_face_corner(
                faces, index < mesh->mNumVertices ? (uint64_t)first + index : UMBB_BAD_CORNER,
                error));
        }
        UMB__TRY(face->mNumIndices >= 3 ? umbb_face_end(faces, error) : UMB_OK);
    }
    return UMB_OK;
}

/* Converts one mesh. Out: index of the builder's mesh, or none. */
static enum umb_status add_mesh(struct conversion *c, const struct aiMesh *mesh, uint32_t *index,
                                struct umb_error *error)
{
    struct umbs_scene_builder *builder = c->faces.scene;
    const uint32_t material = choose_material(c, mesh);
    uint32_t first_vertex = (uint32_t)builder->positions.count;
    size_t first_triangle = builder->triangles.count;
    *index = UMBS_NO_INDEX;
    if (mesh->mVertices == NULL || mesh->mFaces == NULL) {
        return UMB_OK;
    }
    enum umb_status status = add_vertices(c, mesh, material, error);
    if (status == UMB_OK) {
        status = add_faces(&c->faces, mesh, first_vertex, error);
    }
    uint32_t count = (uint32_t)(builder->triangles.count - first_triangle);
    if (status != UMB_OK || count == 0) {
        return status;
    }
    uint32_t(*triangles)[3] = builder->triangles.data;
    for (size_t i = first_triangle; i < builder->triangles.count; i++) {
        for (int k = 0; k < 3; k++) {
            triangles[i][k] -= first_vertex;
        }
    }
    status = umbs_scene_end_mesh(builder, first_vertex, mesh->mNumVertices, count, material, error);
    if (status == UMB_OK) {
        *index = (uint32_t)builder->meshes.count - 1;
    }
    return status;
}

static void warn_about_losses(const struct conversion *c)
{
    struct umbs_scene_builder *builder = c->faces.scene;
    const struct aiScene *scene = c->scene;
    unsigned skinned = 0;
    unsigned morphed = 0;
    for (unsigned i = 0; i < scene->mNumMeshes; i++) {
        skinned += scene->mMeshes[i]->mNumBones > 0;
        morphed += scene->mMeshes[i]->mNumAnimMeshes > 0;
    }
    if (c->bare > 0) {
        umbs_scene_warn(builder,
                        "%u meshes whose alpha is a texture have no coordinates in it and are "
                        "taken as opaque",
                        c->bare);
    }
    if (skinned > 0) {
        umbs_scene_warn(builder, "%u skinned meshes are taken in their rest pose", skinned);
    }
    if (morphed > 0) {
        umbs_scene_warn(builder, "%u meshes with morph targets are taken without them", morphed);
    }
    if (scene->mNumAnimations > 0) {
        umbs_scene_warn(builder, "%u animations are ignored: the scene is taken as static",
                        scene->mNumAnimations);
    }
}

static enum umb_status convert(struct conversion *c, struct umb_error *error)
{
    const struct aiScene *scene = c->scene;
    struct umbs_scene_builder *builder = c->faces.scene;
    uint32_t *mesh_of = calloc(scene->mNumMeshes, sizeof(*mesh_of));
    c->mappings = calloc((size_t)scene->mNumMaterials + 1, sizeof(*c->mappings));
    enum umb_status status = UMB_OK;
    if (mesh_of == NULL || c->mappings == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory");
    } else {
        status = umbb_gltf_sets_find(c->textures.job, c->kind, &c->sets, error);
    }
    for (unsigned i = 0; status == UMB_OK && c->has_materials && i < scene->mNumMaterials; i++) {
        status = add_material(c, i, error);
    }
    for (unsigned i = 0; status == UMB_OK && i < scene->mNumMeshes; i++) {
        status = add_mesh(c, scene->mMeshes[i], &mesh_of[i], error);
    }
    if (status == UMB_OK) {
        warn_about_losses(c);
        status = umbb_assimp_nodes(scene, mesh_of, c->textures.job, c->kind, error);
    }
    if (status == UMB_OK && builder->world_triangles == 0) {
        status = umb_fail(error, UMB_E_BAD_SCENE,
                          "no node shows a triangle (%u meshes, %zu "
                          "triangles, %u faces dropped)",
                          scene->mNumMeshes, builder->triangles.count, builder->dropped_faces);
    }
    free(mesh_of);
    free(c->mappings);
    free(c->sets.materials.data);
    return status;
}

enum umb_status umbb_assimp_read(struct umbb_import *job, enum umbb_kind kind,
                                 struct umb_error *error)
{
    struct umbb_assimp_files files;
    const char *name = kind == UMBB_KIND_GLTF  ? "scene.gltf"
                       : kind == UMBB_KIND_GLB ? "scene.glb"
                                               : "scene.stl";
    umbb_assimp_files_init(&files, job, name);
    struct aiScene *scene = NULL;
    enum umb_status status = UMB_OK;
    if (kind != UMBB_KIND_STL) {
        status = umbb_gltf_guard(job, kind, error);
    }
    if (status == UMB_OK) {
        status = load(&files, name, &scene, error);
    }
    if (status == UMB_OK) {
        struct conversion conversion = {
            .scene = scene, .kind = kind, .has_materials = kind != UMBB_KIND_STL};
        umbb_faces_init(&conversion.faces, &job->scene);
        umbb_texture_table_init(&conversion.textures, job);
        status = convert(&conversion, error);
        umbb_faces_finish(&conversion.faces);
        umbb_texture_table_finish(&conversion.textures);
        aiReleaseImport(scene);
    }
    return status;
}
