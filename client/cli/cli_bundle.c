/* SPDX-License-Identifier: Apache-2.0 */
/* Finding a scene's files, see cli_bundle.h. */
#define _XOPEN_SOURCE 700 /* realpath, beside what -D_POSIX_C_SOURCE gives */
#include "cli_bundle.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tool/tool_try.h"

#define PATH_SIZE     4096
#define SCENE_BYTES   ((size_t)1 << 30)  /* largest scene that is searched for names */
#define LIBRARY_BYTES ((size_t)64 << 20) /* largest library of materials that is searched */
#define NAMES_MAX     262144             /* most names that are looked up for one scene */

struct gathering {
    struct umbc_bundle *bundle;
    char folder[PATH_SIZE]; /* folder of the scene, absolute, without the last slash */
    size_t names;           /* number of names looked up */
    int quiet;
    struct umb_error *error;
};

void umbc_bundle_finish(struct umbc_bundle *bundle)
{
    for (size_t i = 0; i < bundle->count; i++) {
        free((char *)(uintptr_t)bundle->files[i].source);
    }
    free(bundle->files);
    *bundle = (struct umbc_bundle){NULL, 0};
}

/* Opens a regular file. Out: size: bytes of the file, at most `most`. */
static enum umb_status open_text(const char *path, size_t most, int *fd, size_t *size,
                                 struct umb_error *error)
{
    struct stat info;
    /* Non-blocking: a pipe without a writer is refused at once. */
    *fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (*fd < 0) {
        return umb_fail_errno(error, UMB_E_NO_INPUT, errno, "cannot open '%.200s'", path);
    }
    enum umb_status status = UMB_OK;
    if (fstat(*fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        status = umb_fail(error, UMB_E_NO_INPUT, "'%.200s' is not a regular file", path);
    } else if ((uint64_t)info.st_size > most) {
        status = umb_fail(error, UMB_E_LIMIT,
                          "'%.200s': %lld bytes, the limit of a file that names others is %zu",
                          path, (long long)info.st_size, most);
    }
    if (status != UMB_OK) {
        (void)close(*fd);
        return status;
    }
    *size = (size_t)info.st_size;
    return UMB_OK;
}

/* Reads a file of at most `most` bytes and appends a NUL. Out: text: the caller calls free(). */
static enum umb_status read_text(const char *path, size_t most, char **text, size_t *size,
                                 struct umb_error *error)
{
    int fd;
    size_t wanted = 0;
    *text = NULL;
    *size = 0;
    UMB__TRY(open_text(path, most, &fd, &wanted, error));
    *text = malloc(wanted + 1);
    if (*text == NULL) {
        (void)close(fd);
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory to read '%.200s'", path);
    }
    ssize_t got = 1;
    while (*size < wanted && (got > 0 || (got < 0 && errno == EINTR))) {
        got = read(fd, *text + *size, wanted - *size);
        *size += got > 0 ? (size_t)got : 0;
    }
    (*text)[*size] = '\0';
    const int code = errno;
    (void)close(fd);
    return got >= 0 ? UMB_OK : umb_fail_errno(error, UMB_E_IO, code, "cannot read '%.200s'", path);
}

/* Removes "." and ".." from an absolute path, in place. Returns false if it leaves the root. */
static bool normalise(char *path)
{
    char *to = path;
    const char *from = path;
    while (*from != '\0') {
        while (*from == '/') {
            from++;
        }
        const size_t length = strcspn(from, "/");
        if (length == 2 && from[0] == '.' && from[1] == '.') {
            if (to == path) {
                return false;
            }
            while (*--to != '/') {
            }
        } else if (length > 0 && !(length == 1 && from[0] == '.')) {
            *to++ = '/';
            memmove(to, from, length);
            to += length;
        }
        from += length;
    }
    *to = '\0';
    return true;
}

/* Adds a file by its absolute path, unless the bundle has it. Out: added: true for a new file. */
static enum umb_status add_path(struct gathering *g, const char *path, bool *added)
{
    struct umbc_bundle *bundle = g->bundle;
    *added = false;
    for (size_t i = 0; i < bundle->count; i++) {
        if (strcmp(bundle->files[i].source, path) == 0) {
            return UMB_OK;
        }
    }
    if (bundle->count == UMBC_BUNDLE_FILES_MAX) {
        return umb_fail(g->error, UMB_E_LIMIT, "the scene names more than %d files",
                        UMBC_BUNDLE_FILES_MAX);
    }
    struct umb_job_file *files =
        realloc(bundle->files, (bundle->count + 1) * sizeof *bundle->files);
    if (files == NULL) {
        return umb_fail(g->error, UMB_E_NO_MEMORY, "out of memory for the scene's files");
    }
    bundle->files = files;
    files[bundle->count].source = strdup(path);
    files[bundle->count].path = NULL;
    if (files[bundle->count].source == NULL) {
        return umb_fail(g->error, UMB_E_NO_MEMORY, "out of memory for the scene's files");
    }
    bundle->count++;
    *added = true;
    return UMB_OK;
}

/* Counts a look-up of a name, and fails after too many: a large scene may hold millions of
 * names. */
static enum umb_status count_name(struct gathering *g)
{
    g->names++;
    return g->names <= NAMES_MAX ? UMB_OK
                                 : umb_fail(g->error, UMB_E_LIMIT,
                                            "the scene names files more than %d times", NAMES_MAX);
}

/* True if a file lies in the scene's folder after all links are followed. Files elsewhere are not
 * sent: a scene from a stranger could name any file of the user. */
static bool is_beneath(const struct gathering *g, const char *path)
{
    char *folder = realpath(g->folder[0] != '\0' ? g->folder : "/", NULL);
    char *found = folder != NULL ? realpath(path, NULL) : NULL;
    const size_t length = found != NULL && strcmp(folder, "/") != 0 ? strlen(folder) : 0;
    const bool beneath =
        found != NULL && strncmp(found, folder, length) == 0 && found[length] == '/';
    free(folder);
    free(found);
    return beneath;
}

/* Adds a file that the scene names, if it is in the scene's folder. Out: path: path of the file if
 * it was added, else "". */
static enum umb_status add_named(struct gathering *g, const char *name, char path[2 * PATH_SIZE])
{
    struct stat info;
    path[0] = '\0';
    if (name[0] == '\0' || strlen(name) >= PATH_SIZE) {
        return UMB_OK;
    }
    UMB__TRY(count_name(g));
    (void)snprintf(path, 2 * (size_t)PATH_SIZE, "%s/%s", g->folder, name);
    for (char *at = path; *at != '\0'; at++) {
        *at = *at == '\\' ? '/' : *at; /* exporters on Windows write backslashes */
    }
    const char *why = !normalise(path) || stat(path, &info) != 0 || !S_ISREG(info.st_mode) ? "here"
                      : !is_beneath(g, path) ? "sent: it lies outside of the scene's folder"
                                             : NULL;
    if (why != NULL && !g->quiet) {
        (void)fprintf(stderr, "umbrage: notice: the scene names '%.200s', which is not %s\n", name,
                      why);
    }
    bool added = false;
    const enum umb_status status = why == NULL ? add_path(g, path, &added) : UMB_OK;
    if (!added) {
        path[0] = '\0';
    }
    return status;
}

static int hex_digit(char c)
{
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
}

/* Decodes the %XX of a URI, in place. */
static void decode_uri(char *text)
{
    char *to = text;
    for (const char *from = text; *from != '\0'; from++) {
        int high = *from == '%' ? hex_digit(from[1]) : -1;
        int low = high >= 0 ? hex_digit(from[2]) : -1;
        if (low >= 0 && (high | low) != 0) {
            *to++ = (char)(high * 16 + low);
            from += 2;
        } else {
            *to++ = *from;
        }
    }
    *to = '\0';
}

/* Copies a JSON string, from the byte after the opening quote. Returns the end of the string, or
 * NULL if there is none or the string does not fit. \u escapes beyond ASCII are not decoded: no
 * exporter writes such file names. */
static const char *take_json_string(const char *from, const char *end, char out[PATH_SIZE])
{
    size_t used = 0;
    while (from < end && *from != '"') {
        char c = *from++;
        if (c == '\\' && from < end) {
            c = *from++;
            if (c == 'u' && end - from >= 4 && from[0] == '0' && from[1] == '0') {
                c = (char)(hex_digit(from[2]) * 16 + hex_digit(from[3]));
                from += 4;
            }
        }
        if (used + 1 == PATH_SIZE) {
            return NULL;
        }
        out[used++] = c;
    }
    out[used] = '\0';
    return from < end ? from : NULL;
}

/* Adds the file of every "uri": "...", except for URIs that hold the data themselves. */
static enum umb_status look_for_uris(struct gathering *g, const char *text, size_t size)
{
    static const char key[] = "\"uri\"";
    const char *end = text + size, *at = text;
    enum umb_status status = UMB_OK;
    while (status == UMB_OK && (size_t)(end - at) > sizeof key) {
        at = memchr(at, '"', (size_t)(end - at));
        if (at == NULL || (size_t)(end - at) <= sizeof key) {
            break;
        }
        if (memcmp(at, key, sizeof key - 1) != 0) {
            at++;
            continue;
        }
        char name[PATH_SIZE], path[2 * PATH_SIZE];
        at += sizeof key - 1;
        while (at < end && (isspace((unsigned char)*at) || *at == ':')) {
            at++;
        }
        if (at < end && *at == '"' && take_json_string(at + 1, end, name) != NULL &&
            strncmp(name, "data:", 5) != 0) {
            decode_uri(name);
            status = add_named(g, name, path);
        }
    }
    return status;
}

/* Copies the rest of a line that begins with a word, without blanks around the rest. Returns false
 * if the line begins with another word. */
static bool take_line(const char *line, size_t length, const char *word, char out[PATH_SIZE])
{
    const size_t skip = strlen(word);
    if (length <= skip || strncasecmp(line, word, skip) != 0 ||
        !isspace((unsigned char)line[skip])) {
        return false;
    }
    line += skip;
    length -= skip;
    while (length > 0 && isspace((unsigned char)*line)) {
        line++;
        length--;
    }
    while (length > 0 && isspace((unsigned char)line[length - 1])) {
        length--;
    }
    if (length == 0 || length >= PATH_SIZE) {
        return false;
    }
    memcpy(out, line, length);
    out[length] = '\0';
    return true;
}

/* Calls take for each line. */
static enum umb_status each_line(struct gathering *g, const char *path, size_t most,
                                 enum umb_status (*take)(struct gathering *, const char *, size_t))
{
    char *text;
    size_t size;
    enum umb_status status = read_text(path, most, &text, &size, g->error);
    const char *end = text + size;
    for (const char *at = text; status == UMB_OK && at < end;) {
        const char *newline = memchr(at, '\n', (size_t)(end - at));
        const char *stop = newline != NULL ? newline : end;
        while (at < stop && isspace((unsigned char)*at)) {
            at++;
        }
        status = take(g, at, (size_t)(stop - at));
        at = stop + 1;
    }
    free(text);
    return status;
}

/* Finds the file name after a map's options. Names may hold blanks, so the name is the longest rest
 * of the line that is a file; if there is none, the last word. */
static const char *behind_options(struct gathering *g, const char *line)
{
    const char *last = line;
    char path[2 * PATH_SIZE];
    for (const char *at = line; (at = strpbrk(at, " \t")) != NULL;) {
        at += strspn(at, " \t");
        (void)snprintf(path, sizeof path, "%s/%s", g->folder, at);
        last = at;
        if (count_name(g) != UMB_OK || access(path, R_OK) == 0) {
            break; /* beyond the limit add_named refuses the name */
        }
    }
    return last;
}

/* Adds the texture that a line names after options such as `-o 0 0 0`. */
static enum umb_status take_mtl_line(struct gathering *g, const char *line, size_t length)
{
    static const char *const words[] = {"map_Kd", "map_Ka", "map_Ks", "map_d", "map_bump", "bump"};
    char name[PATH_SIZE], path[2 * PATH_SIZE];
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (take_line(line, length, words[i], name)) {
            return add_named(g, name[0] == '-' ? behind_options(g, name) : name, path);
        }
    }
    return UMB_OK;
}

static enum umb_status take_obj_line(struct gathering *g, const char *line, size_t length)
{
    char name[PATH_SIZE], path[2 * PATH_SIZE];
    if (!take_line(line, length, "mtllib", name)) {
        return UMB_OK;
    }
    enum umb_status status = add_named(g, name, path);
    /* A material library is read only when it is added to the bundle, so once: every line of a
     * scene may name it. */
    return status == UMB_OK && path[0] != '\0' ? each_line(g, path, LIBRARY_BYTES, take_mtl_line)
                                               : status;
}

static bool ends_in(const char *text, const char *ending)
{
    const size_t length = strlen(text), tail = strlen(ending);
    return length > tail && strcasecmp(text + length - tail, ending) == 0;
}

static enum umb_status look_through(struct gathering *g, const char *scene)
{
    if (ends_in(scene, ".obj")) {
        return each_line(g, scene, SCENE_BYTES, take_obj_line);
    }
    if (!ends_in(scene, ".gltf") && !ends_in(scene, ".glb")) {
        return UMB_OK;
    }
    char *text;
    size_t size;
    enum umb_status status = read_text(scene, SCENE_BYTES, &text, &size, g->error);
    if (status == UMB_OK) {
        size_t json = size; /* a GLB has it in its first chunk, after headers of 12 and 8 bytes */
        if (size > 20 && memcmp(text, "glTF", 4) == 0) {
            const unsigned char *length = (const unsigned char *)text + 12;
            json = 20 + ((size_t)length[0] | (size_t)length[1] << 8 | (size_t)length[2] << 16 |
                         (size_t)length[3] << 24);
            json = json < size ? json : size;
        }
        status = look_for_uris(g, text, json);
    }
    free(text);
    return status;
}

/* Returns the length in bytes, with its slash, of the deepest folder that holds all files. */
static size_t common_folder(const struct umbc_bundle *bundle)
{
    const char *first = bundle->files[0].source;
    size_t length = (size_t)(strrchr(first, '/') - first) + 1;
    for (size_t i = 1; i < bundle->count; i++) {
        while (strncmp(first, bundle->files[i].source, length) != 0) {
            length--;
            while (length > 1 && first[length - 1] != '/') {
                length--;
            }
        }
    }
    return length;
}

static bool is_scene(const char *path)
{
    static const char *const endings[] = {".gltf", ".glb", ".obj", ".ply", ".stl"};
    for (size_t i = 0; i < sizeof endings / sizeof endings[0]; i++) {
        if (ends_in(path, endings[i])) {
            return true;
        }
    }
    return false;
}

enum umb_status umbc_bundle_gather(const char *scene, int quiet, struct umbc_bundle *bundle,
                                   struct umb_error *error)
{
    struct gathering g = {.bundle = bundle, .quiet = quiet, .error = error};
    char path[2 * PATH_SIZE] = "";
    *bundle = (struct umbc_bundle){NULL, 0};
    if (scene[0] != '/' && getcwd(g.folder, sizeof g.folder) == NULL) {
        return umb_fail_errno(error, UMB_E_IO, errno, "cannot tell the present folder");
    }
    if (strlen(scene) >= PATH_SIZE) {
        return umb_fail(error, UMB_E_NO_INPUT, "the scene's name is too long");
    }
    (void)snprintf(path, sizeof path, "%s/%s", scene[0] == '/' ? "" : g.folder, scene);
    struct stat info;
    if (stat(scene, &info) != 0) {
        return umb_fail_errno(error, UMB_E_NO_INPUT, errno, "cannot open '%.200s'", scene);
    }
    if (!S_ISREG(info.st_mode) || !normalise(path) || strlen(path) >= PATH_SIZE) {
        return umb_fail(error, UMB_E_NO_INPUT, "'%.200s' is not a regular file", scene);
    }
    if (!is_scene(scene)) { /* refused here, before anything is sent */
        return umb_fail(error, UMB_E_BAD_SCENE,
                        "'%.200s': not a scene that can be baked (.gltf .glb .obj .ply .stl)",
                        scene);
    }
    (void)snprintf(g.folder, sizeof g.folder, "%.*s", (int)(strrchr(path, '/') - path), path);
    bool added;
    enum umb_status status = add_path(&g, path, &added);
    status = status == UMB_OK ? look_through(&g, path) : status;
    if (status != UMB_OK) {
        umbc_bundle_finish(bundle);
        return status;
    }
    const size_t common = common_folder(bundle);
    for (size_t i = 0; i < bundle->count; i++) {
        bundle->files[i].path = bundle->files[i].source + common;
    }
    return UMB_OK;
}
