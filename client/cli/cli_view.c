/* SPDX-License-Identifier: Apache-2.0 */
/*
 * umbrage view: shows an asset, with its scene, in the browser. The command gathers the files of
 * the page (the viewer, the package umbrage, three.js, the scene and the asset) and serves them on
 * this machine, or writes them into a folder for a web server.
 */
#include "cli/shared/cli_common.h"

#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cli_bundle.h"
#include "cli_origin.h"
#include "cli_view_server.h"
#include "cli_view_site.h"
#include "tool/json.h"
#include "tool/output.h"
#include "tool/tool_try.h"

#define PATH_SIZE   8192
#define THREE       "/usr/share/javascript/three"
#define NAME_LENGTH 64 /* Bytes of the title that come from the asset's name */

struct view_settings {
    const char *target, *scene, *folder; /* folder: of --export, or NULL */
    unsigned port, up;
    struct umbu_session session;
    bool json, quiet, force;
};
#define AT(field) UMBU_AT(struct view_settings, field)

static const struct umbu_option OPTIONS[] = {
    {"FILE|ASSET|URL", NULL,
     "packed asset file (.umb), asset of the daemon, or http:// or https:// address of a packed "
     "file",
     UMBU_TEXT, AT(target), .needed = true},
    {"scene", "SCENE", "scene to show (.glb .gltf .obj .ply .stl); without it a plane is shown",
     UMBU_TEXT, AT(scene)},
    {"up", "y|z", "the scene's up axis", UMBU_CHOICE("|y|z"), AT(up),
     .otherwise = "as the asset was baked"},
    {"force", NULL, "goes on even if the asset was baked from another scene", UMBU_FLAG, AT(force),
     .needs = "scene"},
    {"port", "N", "port on 127.0.0.1; 0 = any that is free", UMBU_COUNT(0, 65535), AT(port),
     .standard = "0"},
    {"export", "DIR",
     "new or empty folder for the page and its files, which any web server with byte ranges can "
     "serve; nothing is served",
     UMBU_NAME("the name of a folder"), AT(folder), .excludes = "port"},
    {UMBU_JSON_ROW(struct view_settings)},
    {UMBU_QUIET_ROW(struct view_settings, "print nothing but errors and the address")},
};

static const struct umbu_command COMMAND = {
    .name = "umbrage view",
    .usage = "umbrage view (FILE | ASSET | URL) [--scene SCENE] [options]",
    .summary = "Shows an asset in the browser: starts a web server on this machine, prints its\n"
               "address, and serves until it is stopped. The page fetches the parts of the asset\n"
               "that the camera needs.",
    .sections = {{"options", UMBU_ROWS(OPTIONS)}, UMBU_SESSION(struct view_settings, session)},
};

/* Finds the folder of the page: beside the program in a build, in share/ of an installation. */
static enum umb_status find_web(char web[PATH_SIZE], struct umb_error *error)
{
    static const char *const places[] = {"web", "../share/umbrage/web"};
    char own[PATH_SIZE / 2], page[PATH_SIZE + 32];
    for (size_t i = 0; i < 2 && umbc_own_folder(own, sizeof own); i++) {
        (void)snprintf(web, PATH_SIZE, "%s/%s", own, places[i]);
        (void)snprintf(page, sizeof page, "%s/umbrage/umbrage.wasm", web);
        if (access(page, R_OK) == 0) {
            return UMB_OK;
        }
    }
    return umb_fail(error, UMB_E_UNSUPPORTED,
                    "view: the page is not installed; build it by `make web` (clang, lld, "
                    "wasi-libc, libclang-rt-dev-wasm32)");
}

/* Adds the files of a folder under a prefix; folders in it are left out. */
static enum umb_status add_folder(struct umbc_view_site *site, const char *folder,
                                  const char *prefix, struct umb_error *error)
{
    enum umb_status status = UMB_OK;
    DIR *list = opendir(folder);
    if (list == NULL) {
        return umb_fail_errno(error, UMB_E_NO_INPUT, errno, "view: cannot read '%.200s'", folder);
    }
    const struct dirent *entry;
    while (status == UMB_OK && (entry = readdir(list)) != NULL) {
        char source[2 * PATH_SIZE], path[PATH_SIZE];
        struct stat info;
        (void)snprintf(source, sizeof source, "%s/%s", folder, entry->d_name);
        (void)snprintf(path, sizeof path, "%s%s", prefix, entry->d_name);
        if (entry->d_name[0] != '.' && stat(source, &info) == 0 && S_ISREG(info.st_mode)) {
            status = umbc_view_site_add(site, path, source, NULL, 0, error);
        }
    }
    (void)closedir(list);
    return status;
}

/* Adds three.js and its loaders, from Debian's package. */
static enum umb_status add_three(struct umbc_view_site *site, struct umb_error *error)
{
    static const char *const files[] = {
        "build/three.module.js",
        "examples/jsm/controls/OrbitControls.js",
        "examples/jsm/loaders/GLTFLoader.js",
        "examples/jsm/loaders/MTLLoader.js",
        "examples/jsm/loaders/OBJLoader.js",
        "examples/jsm/loaders/PLYLoader.js",
        "examples/jsm/loaders/STLLoader.js",
    };
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++) {
        char source[PATH_SIZE], path[PATH_SIZE];
        (void)snprintf(source, sizeof source, THREE "/%s", files[i]);
        (void)snprintf(path, sizeof path, "three/%s", files[i]);
        if (access(source, R_OK) != 0) {
            return umb_fail(error, UMB_E_UNSUPPORTED,
                            "view: '%s' is missing; install the package libjs-three", source);
        }
        UMB__TRY(umbc_view_site_add(site, path, source, NULL, 0, error));
    }
    return UMB_OK;
}

/* Returns true for the types of files that a browser only reads. A foreign scene may name any file
 * in its folder; a page or script among these files would run with the rights of the site. */
static bool is_passive(const char *path)
{
    static const char *const endings[] = {".glb", ".gltf", ".bin",  ".obj",  ".mtl",
                                          ".ply", ".stl",  ".png",  ".jpg",  ".jpeg",
                                          ".bmp", ".tga",  ".webp", ".ktx2", ".dds"};
    const char *point = strrchr(path, '.');
    for (size_t i = 0; point != NULL && i < sizeof endings / sizeof endings[0]; i++) {
        if (strcasecmp(point, endings[i]) == 0) {
            return true;
        }
    }
    return false;
}

/* Adds the scene and the files that it names. Out: path: of the scene in the site. */
static enum umb_status add_scene(struct umbc_view_site *site, const struct view_settings *settings,
                                 char path[PATH_SIZE], struct umb_error *error)
{
    struct umbc_bundle bundle;
    char other[PATH_SIZE];
    UMB__TRY(umbc_bundle_gather(settings->scene, settings->quiet, &bundle, error));
    enum umb_status status = UMB_OK;
    for (size_t i = 0; i < bundle.count && status == UMB_OK; i++) {
        (void)snprintf(i == 0 ? path : other, PATH_SIZE, "scene/%s", bundle.files[i].path);
        status = is_passive(bundle.files[i].path)
                     ? umbc_view_site_add(site, i == 0 ? path : other, bundle.files[i].source, NULL,
                                          0, error)
                     : umb_fail(error, UMB_E_UNSUPPORTED,
                                "--scene: names '%.200s', which is no mesh, material or image",
                                bundle.files[i].path);
    }
    umbc_bundle_finish(&bundle);
    return status != UMB_OK || settings->force
               ? status
               : umbc_view_scene_match(site, settings->target, settings->scene, settings->quiet,
                                       error);
}

/* Returns the last part of a path or an address. What follows ? or # may be a secret, and so may
 * what stands before an @ in an address. */
static const char *name_of(const char *target, size_t *length)
{
    const bool is_address = strstr(target, "://") != NULL;
    const size_t end = is_address ? strcspn(target, "?#") : strlen(target);
    size_t begin = end > 0 ? end - 1 : 0;
    while (begin > 0 && target[begin - 1] != '/' && !(is_address && target[begin - 1] == '@')) {
        begin--;
    }
    *length = end - begin < NAME_LENGTH ? end - begin : NAME_LENGTH;
    return target + begin;
}

/* Adds what the page must know. */
static enum umb_status add_config(struct umbc_view_site *site, const struct view_settings *settings,
                                  const char *asset, const char *scene, struct umb_error *error)
{
    char *text = NULL;
    size_t size = 0;
    FILE *file = open_memstream(&text, &size);
    if (file == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "view: out of memory");
    }
    size_t length;
    const char *name = name_of(settings->target, &length);
    struct umbu_json json = umbu_json_open(file);
    umbu_json_bytes(&json, "name", name, length);
    umbu_json_text(&json, "asset", asset);
    umbc_json_id(&json, "id", site->head.id);
    umbu_json_text(&json, "up",
                   settings->up == 0 ? (site->z_up ? "z" : "y") : (settings->up == 1 ? "y" : "z"));
    if (scene[0] != '\0') {
        umbu_json_text(&json, "scene", scene);
    }
    umbu_json_close(&json);
    const bool failed = ferror(file) != 0;
    if (fclose(file) != 0 || failed) {
        free(text);
        return umb_fail(error, UMB_E_NO_MEMORY, "view: out of memory");
    }
    return umbc_view_site_add(site, "config.json", NULL, text, size, error);
}

static enum umb_status fill(struct umbc_view_site *site, const struct view_settings *settings,
                            struct umb_error *error)
{
    char web[PATH_SIZE], folder[PATH_SIZE + 32], scene[PATH_SIZE] = "", id[UMB_ID_TEXT_SIZE];
    char asset[UMB_ID_TEXT_SIZE + 16];
    UMB__TRY(find_web(web, error));
    (void)snprintf(folder, sizeof folder, "%s/viewer", web);
    UMB__TRY(add_folder(site, folder, "", error));
    (void)snprintf(folder, sizeof folder, "%s/umbrage", web);
    UMB__TRY(add_folder(site, folder, "umbrage/", error));
    UMB__TRY(add_three(site, error));
    if (settings->scene != NULL) {
        UMB__TRY(add_scene(site, settings, scene, error));
    }
    umb_id_to_text(site->head.id, id);
    (void)snprintf(asset, sizeof asset, "asset-%s.umb", id);
    UMB__TRY(umbc_view_site_add(site, asset, NULL, NULL, 0, error));
    return add_config(site, settings, asset, scene, error);
}

/* --- export --- */

/* Makes the folders of a path below the folder of the export. */
static enum umb_status make_folders(char *path, size_t from, struct umb_error *error)
{
    for (char *slash = strchr(path + from, '/'); slash != NULL; slash = strchr(slash + 1, '/')) {
        *slash = '\0';
        const int failed = mkdir(path, 0777) != 0 && errno != EEXIST;
        const int code = errno;
        *slash = '/';
        if (failed) {
            return umb_fail_errno(error, UMB_E_CANNOT_CREATE, code, "cannot create '%.200s'", path);
        }
    }
    return UMB_OK;
}

/* Makes the folder of the export, or checks that it is empty. */
static enum umb_status make_export(const char *folder, struct umb_error *error)
{
    if (mkdir(folder, 0777) == 0) {
        return UMB_OK;
    }
    const int code = errno;
    DIR *list = opendir(folder);
    if (list == NULL) {
        return umb_fail_errno(error, UMB_E_CANNOT_CREATE, code, "--export: cannot create '%.200s'",
                              folder);
    }
    const struct dirent *entry;
    bool is_empty = true;
    while (is_empty && (entry = readdir(list)) != NULL) {
        is_empty = strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0;
    }
    (void)closedir(list);
    return is_empty
               ? UMB_OK
               : umb_fail(error, UMB_E_CANNOT_CREATE, "--export: '%.200s' is not empty", folder);
}

struct copy {
    struct umbc_view_site *site;
    const struct umbc_view_file *file;
    uint64_t bytes; /* Bytes written, of all files */
};

static enum umb_status copy_bytes(void *user, const struct umb_sink *sink, struct umb_error *error)
{
    static uint8_t piece[1 << 20];
    struct copy *copy = user;
    struct umbc_view_body body;
    UMB__TRY(umbc_view_body_open(copy->site, copy->file, &body, error));
    enum umb_status status = UMB_OK;
    for (uint64_t at = 0; at < body.size && status == UMB_OK;) {
        const uint64_t left = body.size - at;
        const size_t size = left < sizeof piece ? (size_t)left : sizeof piece;
        status = umbc_view_body_read(&body, at, piece, size, error);
        status = status == UMB_OK ? sink->write(sink->user, piece, size) : status;
        at += size;
    }
    copy->bytes += body.size;
    umbc_view_body_close(&body);
    return status;
}

static int export_site(struct umbc_view_site *site, const struct view_settings *settings,
                       struct umb_error *error)
{
    struct copy copy = {.site = site};
    const size_t length = strlen(settings->folder);
    enum umb_status status = make_export(settings->folder, error);
    for (size_t i = 0; i < site->count && status == UMB_OK; i++) {
        char path[2 * PATH_SIZE];
        copy.file = &site->files[i];
        (void)snprintf(path, sizeof path, "%s/%s", settings->folder, copy.file->path);
        status = make_folders(path, length + 1, error);
        if (status == UMB_OK) {
            status = umbu_output_write_by(path, UMBU_OUTPUT_COMMAND, copy_bytes, &copy, error);
        }
    }
    if (status != UMB_OK) {
        return umbc_complain(error);
    }
    if (settings->json) {
        struct umbu_json json = umbu_json_open(stdout);
        umbu_json_text(&json, "folder", settings->folder);
        UMBU_JSON_COUNTS(&json, {"files", site->count}, {"bytes", copy.bytes});
        umbu_json_close(&json);
    } else if (!settings->quiet) {
        char text[32];
        umbc_format_bytes(copy.bytes, text);
        (void)printf("%s: %zu files, %s\n", settings->folder, site->count, text);
    }
    return umbc_finish_stdout(0);
}

/* --- serve --- */

static int serve_site(struct umbc_view_site *site, const struct umbc_view_listener *listener,
                      const struct view_settings *settings, struct umb_error *error)
{
    char address[64 + UMBC_VIEW_KEY_SIZE];
    (void)snprintf(address, sizeof address, "http://127.0.0.1:%u/%s/", listener->port,
                   listener->key);
    if (settings->json) {
        struct umbu_json json = umbu_json_open(stdout);
        umbu_json_text(&json, "address", address);
        umbu_json_close(&json);
    } else {
        (void)printf("%s\n", address);
    }
    int code = umbc_finish_stdout(0);
    if (code == 0) {
        if (!settings->quiet) {
            (void)fprintf(stderr, "umbrage view: open this address in a browser; Ctrl-C stops\n");
        }
        code = umbc_view_serve(listener, site, error) == UMB_OK ? 0 : umbc_complain(error);
    }
    return code;
}

/* Says where the target is: on a web server, in a file or on a daemon. */
static struct umbc_origin find_origin(const struct view_settings *settings)
{
    const char *target = settings->target;
    struct umbc_origin origin = {.session = settings->session};
    const bool web = strncmp(target, "http://", 7) == 0 || strncmp(target, "https://", 8) == 0;
    *(web ? &origin.url : umbc_is_file(target) ? &origin.file : &origin.asset) = target;
    return origin;
}

/* Opens the asset, gathers the files, and serves or exports them. */
static int show(const struct umbc_view_listener *listener, const struct view_settings *settings,
                struct umb_error *error)
{
    struct umbc_origin origin = find_origin(settings);
    struct umb_region_source source;
    struct umbc_view_site site = {.count = 0};
    int code;
    if (umbc_origin_open(&origin, &source, error) == UMB_OK) {
        code = umbc_view_site_begin(&site, &source, error) != UMB_OK
                   ? umbc_complain_file(settings->target, error)
               : fill(&site, settings, error) != UMB_OK ? umbc_complain(error)
               : settings->folder != NULL               ? export_site(&site, settings, error)
                                          : serve_site(&site, listener, settings, error);
        umbc_view_site_finish(&site);
    } else {
        code = umbc_complain(error);
    }
    umbc_origin_close(&origin, &source);
    umbc_origin_finish(&origin);
    return code;
}

int umbc_view(int argc, char **argv)
{
    struct umbu_parsed parsed;
    struct view_settings settings = {.target = NULL};
    struct umb_error error = {.status = UMB_OK};
    int code = umbu_start(&parsed, &COMMAND, argc, argv, &settings);
    if (code >= 0) {
        return code;
    }
    /* A port that is taken is told before anything is read. */
    struct umbc_view_listener listener = {.port = settings.port, .socket = -1};
    if (settings.folder == NULL && umbc_view_listen(&listener, &error) != UMB_OK) {
        return umbc_complain(&error);
    }
    code = show(&listener, &settings, &error);
    if (listener.socket >= 0) {
        (void)close(listener.socket);
    }
    return code;
}
