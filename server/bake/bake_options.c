/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A table of options, one small reader each. `--name value` and `--name=value` are the same.
 */
#include "bake/bake_options.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bake/effect_options.h"
#include "bake/option_text.h"

const char umbb_options_help[] =
    "umbrage-bake SCENE -o OUT.umb [options]     bake the shadows of a scene\n"
    "umbrage-bake SCENE --plan [options]         print what would be baked and why; write nothing\n"
    "umbrage-bake tile SCENE -o DIR [options]    bake tiles and leave their results in a folder\n"
    "umbrage-bake merge SCENE --from DIR -o OUT.umb [options]    make the asset of such tiles\n"
    "umbrage-bake import SCENE -o FILE [options] read a scene once, for many bakes and tiles of "
    "it\n"
    "umbrage-bake doctor [--json | --quiet] [--forbid FILE]...    check this machine and the "
    "sandboxes "
    "of\n"
    "                                            importer and bake\n"
    "\n"
    "SCENE is a glTF, GLB, OBJ, PLY or STL file. --scene-buffer FILE stands for it in every "
    "command "
    "but\n"
    "import: a file that import made. It and its folder must belong to you (or root) and be "
    "writable "
    "by\n"
    "no one else.\n"
    "\n"
    "  -o, --output FILE      the asset to write, replaced atomically\n"
    "  --resolution N         voxels a side, a power of two, 64 to 262144 (16384)\n"
    "  --max-error M          instead of --resolution: the smallest that keeps one tap within M "
    "metres\n"
    "                         of true shadow boundaries; says what that will cost before it "
    "starts\n"
    "  --sun AZ,EL            sun from azimuth AZ (degrees clockwise from north: +y in z-up "
    "scenes,\n"
    "                         -z in y-up ones) and elevation EL (degrees above the horizon)\n"
    "  --sun-path LAT,LON,YYYY-MM-DD,MINUTES\n"
    "                         the suns of that day, one every so many minutes of mean solar time\n"
    "                         from midnight on, while above the horizon (degrees north and east)\n"
    "  --point X,Y,Z          a light that shines all around from there\n"
    "  --spot X,Y,Z,DX,DY,DZ,DEGREES\n"
    "                         a light at X,Y,Z that shines along DX,DY,DZ within so many degrees\n"
    "                         of it, at most 90\n"
    "  --light NAME           the file's light of that name\n"
    "                         The five may be repeated and mixed: all lights share one asset.\n"
    "                         Without them: the file's lights, else --sun 135,45.\n"
    "  --light-size SIZE      how large the lights are, recorded in the asset: as 0.53deg (what\n"
    "                         suns have without it) for directional ones, as 0.25m for others\n"
    "  --up y|z               the up axis (y for glTF, z for OBJ, PLY and STL)\n"
    "  --closed auto|on|off   leave the inside of closed solids undefined: of those that are "
    "closed\n"
    "                         (auto), of everything on your word (on), never (off)\n"
    "  --effect NAME=on|off   overrule the plan: closed, front (first occluders of closed\n"
    "                         solids, for columns), penumbra (on: front as well; off: lights\n"
    "                         without an extent), cut-out (holes by the alpha of textures),\n"
    "                         transmittance (glass, hair: casters that take part of the light),\n"
    "                         static; mraa and voaa can only be off in this version\n"
    "  --static               nothing moves: only points on surfaces are asked for, and what lies\n"
    "                         elsewhere is left undefined, counted in every reply\n"
    "  --threads N            1 to 256 (the processors there are)\n"
    "  --memory SIZE          stay within this, for example 900MiB (4GiB)\n"
    "  --tile N               texels a side baked at a time, a power of two from 64 (4096)\n"
    "  --cache DIR            keep the results of tiles in this folder and use those that are "
    "there:\n"
    "                         a bake that was killed goes on where it was, and after an edit only\n"
    "                         tiles that the edit reaches are baked\n"
    "  --cache-size SIZE      remove what was not used for longest beyond this (10GiB;\n"
    "                         with tile: only if given)\n"
    "  --only I | I-J         with tile: only tile I, or tiles I to J, of those that --plan "
    "counts,\n"
    "                         from 0 on (all)\n"
    "  --from DIR             with merge: the folder that tile wrote to\n"
    "  --depth auto|embree|raster|plain\n"
    "                         how depth is found; all give the same bits (auto: raster; plain: "
    "that\n"
    "                         without vector instructions)\n"
    "  --verify N             compare N points with traced rays before publishing; 0 = off "
    "(1000000)\n"
    "  --sandbox available|required|off\n"
    "                         sandbox of the bake: the layers that this kernel has (available),\n"
    "                         every layer, else exit code 69 (required), or none (off). The\n"
    "                         importer is always in its sandbox (available)\n"
    "  --plan                 print the plan and its reasons only\n"
    "  --json                 print one JSON object\n"
    "  --progress-fd N        tell phases, plan and progress on descriptor N, line by line\n"
    "  -q, --quiet            no notices, no progress, no summary\n"
    "  -h, --help\n"
    "  --version\n"
    "\n"
    "The output appears only when it is complete and has passed the comparison. An interrupt\n"
    "(SIGINT, SIGTERM, SIGQUIT) leaves the old file as it was and ends with 75.\n"
    "\n"
    "tile and merge are units of work for any number of machines that share a folder: the same\n"
    "scene and options make the same tiles, under names that are hashes of what they depend on,\n"
    "and merging them makes the same asset as one bake. A tile that is there already is left\n"
    "alone; a merge that misses a tile, or finds one damaged, ends with 75 and names it.\n"
    "\n"
    "Exit codes: 0 ok, 2 usage, 65 unusable scene, 66 no input, 69 missing importer or sandbox,\n"
    "70 failed comparison, 73 cannot create, 74 input or output error, 75 temporary: "
    "over\n"
    "--memory, out of memory, a tile missing, or interrupted.\n";

#define SIZE_LARGEST ((uint64_t)1 << 50)

/* log2 of a power of two between 2^low and 2^high; -1 for anything else. */
static int read_power(const char *text, uint32_t low, uint32_t high)
{
    uint64_t value;
    const char *rest;
    if (!umbb_option_count(text, &rest, &value) || *rest != '\0' || value == 0 ||
        (value & (value - 1)) != 0) {
        return -1;
    }
    const int log2 = __builtin_ctzll(value);
    return log2 >= (int)low && log2 <= (int)high ? log2 : -1;
}

/* Index of text in names, or -1. */
static int read_choice(const char *text, const char *const *names, int count)
{
    for (int i = 0; i < count; i++) {
        if (strcmp(text, names[i]) == 0) {
            return i;
        }
    }
    return -1;
}

static enum umb_status set_output(struct umbb_options *o, const char *option, const char *value,
                                  struct umb_error *error)
{
    if (value[0] == '\0' || strcmp(value, "-") == 0) {
        return umbb_option_refuse(error, option, value,
                                  "a file name (a bake cannot write to stdout; name a file or "
                                  "folder, ./- for one of that name)");
    }
    o->output = value;
    return UMB_OK;
}

static enum umb_status set_resolution(struct umbb_options *o, const char *option, const char *value,
                                      struct umb_error *error)
{
    const int log2 = read_power(value, UMBB_RESOLUTION_LOG2_MIN, UMBB_RESOLUTION_LOG2_MAX);
    if (log2 < 0) {
        return umbb_option_refuse(error, option, value, "a power of two from 64 to 262144");
    }
    o->resolution_log2 = (uint32_t)log2;
    o->resolution_given = 1;
    return UMB_OK;
}

static enum umb_status set_sun(struct umbb_options *o, const char *option, const char *value,
                               struct umb_error *error)
{
    return umbb_light_option_sun(&o->lights, option, value, error);
}

static enum umb_status set_sun_path(struct umbb_options *o, const char *option, const char *value,
                                    struct umb_error *error)
{
    return umbb_light_option_path(&o->lights, option, value, error);
}

static enum umb_status set_light(struct umbb_options *o, const char *option, const char *value,
                                 struct umb_error *error)
{
    return umbb_light_option_name(&o->lights, option, value, error);
}

static enum umb_status set_spot(struct umbb_options *o, const char *option, const char *value,
                                struct umb_error *error)
{
    return umbb_light_option_spot(&o->lights, option, value, error);
}

static enum umb_status set_point(struct umbb_options *o, const char *option, const char *value,
                                 struct umb_error *error)
{
    return umbb_light_option_point(&o->lights, option, value, error);
}

static enum umb_status set_light_size(struct umbb_options *o, const char *option, const char *value,
                                      struct umb_error *error)
{
    return umbb_light_option_size(&o->lights, option, value, error);
}

static enum umb_status set_up(struct umbb_options *o, const char *option, const char *value,
                              struct umb_error *error)
{
    static const char *const names[] = {"y", "z"};
    const int choice = read_choice(value, names, 2);
    if (choice < 0) {
        return umbb_option_refuse(error, option, value, "y or z");
    }
    o->up = choice == 0 ? UMBB_UP_Y : UMBB_UP_Z;
    return UMB_OK;
}

static enum umb_status set_threads(struct umbb_options *o, const char *option, const char *value,
                                   struct umb_error *error)
{
    uint64_t count;
    const char *rest;
    if (!umbb_option_count(value, &rest, &count) || *rest != '\0' || count < 1 ||
        count > UMBB_THREADS_MAX) {
        return umbb_option_refuse(error, option, value, "a number from 1 to 256");
    }
    o->threads = (unsigned)count;
    return UMB_OK;
}

/* A number of bytes with or without a unit; 0 if it is invalid or too large. */
static uint64_t read_size(const char *value)
{
    static const struct {
        const char *suffix;
        uint32_t shift;
    } units[] = {{"", 0}, {"KiB", 10}, {"MiB", 20}, {"GiB", 30}, {"TiB", 40}};
    uint64_t count;
    const char *rest;
    if (umbb_option_count(value, &rest, &count)) {
        for (size_t i = 0; i < sizeof units / sizeof units[0]; i++) {
            if (strcmp(rest, units[i].suffix) == 0 && count <= UINT64_MAX >> units[i].shift) {
                count <<= units[i].shift;
                return count <= SIZE_LARGEST ? count : 0;
            }
        }
    }
    return 0;
}

static enum umb_status set_memory(struct umbb_options *o, const char *option, const char *value,
                                  struct umb_error *error)
{
    const uint64_t bytes = read_size(value);
    if (bytes < (uint64_t)16 << 20) {
        return umbb_option_refuse(error, option, value,
                                  "a size in bytes, KiB, MiB, GiB or TiB from 16MiB to 1024TiB");
    }
    o->memory_bytes = bytes;
    return UMB_OK;
}

static enum umb_status set_cache_size(struct umbb_options *o, const char *option, const char *value,
                                      struct umb_error *error)
{
    const uint64_t bytes = read_size(value);
    if (bytes < (uint64_t)1 << 20) {
        return umbb_option_refuse(error, option, value,
                                  "a size in bytes, KiB, MiB, GiB or TiB from 1MiB to 1024TiB");
    }
    o->cache_bytes = bytes;
    o->cache_size_given = 1;
    return UMB_OK;
}

static enum umb_status set_folder(const char **folder, const char *option, const char *value,
                                  struct umb_error *error)
{
    if (value[0] == '\0') {
        return umbb_option_refuse(error, option, value, "a folder");
    }
    *folder = value;
    return UMB_OK;
}

static enum umb_status set_cache(struct umbb_options *o, const char *option, const char *value,
                                 struct umb_error *error)
{
    return set_folder(&o->cache, option, value, error);
}

static enum umb_status set_from(struct umbb_options *o, const char *option, const char *value,
                                struct umb_error *error)
{
    return set_folder(&o->from, option, value, error);
}

static enum umb_status set_only(struct umbb_options *o, const char *option, const char *value,
                                struct umb_error *error)
{
    const char *rest;
    int good = umbb_option_count(value, &rest, &o->only_first);
    o->only_last = o->only_first;
    if (good && *rest == '-') {
        good = umbb_option_count(rest + 1, &rest, &o->only_last);
    }
    if (!good || *rest != '\0' || o->only_last < o->only_first) {
        return umbb_option_refuse(error, option, value, "a tile's number, or two as 0-15");
    }
    o->only_given = 1;
    return UMB_OK;
}

static enum umb_status set_max_error(struct umbb_options *o, const char *option, const char *value,
                                     struct umb_error *error)
{
    const char *rest;
    if (!umbb_option_number(value, &rest, &o->max_error_m) ||
        (*rest != '\0' && strcmp(rest, "m") != 0) || !(o->max_error_m > 0)) {
        return umbb_option_refuse(error, option, value, "a length in metres above 0, as 0.02");
    }
    return UMB_OK;
}

static enum umb_status set_tile(struct umbb_options *o, const char *option, const char *value,
                                struct umb_error *error)
{
    const int log2 = read_power(value, UMBB_TILE_LOG2_MIN, UMBB_TILE_LOG2_MAX);
    if (log2 < 0) {
        return umbb_option_refuse(
            error, option, value,
            "a power of two from 64 to 65536 and no larger than --resolution");
    }
    o->tile_log2 = (uint32_t)log2;
    o->tile_given = 1;
    return UMB_OK;
}

static enum umb_status set_depth(struct umbb_options *o, const char *option, const char *value,
                                 struct umb_error *error)
{
    static const char *const names[] = {"auto", "embree", "raster", "plain"};
    const int choice = read_choice(value, names, 4);
    if (choice < 0) {
        return umbb_option_refuse(error, option, value, "auto, embree, raster or plain");
    }
    o->depth = (enum umbb_depth_path)choice;
    return UMB_OK;
}

static enum umb_status set_verify(struct umbb_options *o, const char *option, const char *value,
                                  struct umb_error *error)
{
    uint64_t count;
    const char *rest;
    if (!umbb_option_count(value, &rest, &count) || *rest != '\0' ||
        count > UMBB_VERIFY_POINTS_MAX) {
        return umbb_option_refuse(error, option, value, "a number of points from 0 to 1000000000");
    }
    o->verify_points = count;
    return UMB_OK;
}

static enum umb_status set_sandbox(struct umbb_options *o, const char *option, const char *value,
                                   struct umb_error *error)
{
    static const char *const names[] = {"available", "required", "off"};
    const int choice = read_choice(value, names, 3);
    if (choice < 0) {
        return umbb_option_refuse(error, option, value, "available, required or off");
    }
    o->sandbox = (enum umbb_sandbox_mode)choice;
    return UMB_OK;
}

static enum umb_status take_scene(struct umbb_options *o, const char *word, struct umb_error *error)
{
    if (o->scene != NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "SCENE: '%.64s' is a second one after '%.64s'", word,
                        o->scene);
    }
    o->scene = word;
    return UMB_OK;
}

static enum umb_status set_scene_buffer(struct umbb_options *o, const char *option,
                                        const char *value, struct umb_error *error)
{
    if (value[0] == '\0') {
        return umbb_option_refuse(error, option, value, "a file of umbrage-bake import");
    }
    o->scene_buffer = 1;
    return take_scene(o, value, error);
}

static enum umb_status set_progress_fd(struct umbb_options *o, const char *option,
                                       const char *value, struct umb_error *error)
{
    uint64_t number;
    const char *rest;
    if (!umbb_option_count(value, &rest, &number) || *rest != '\0' || number < 1 || number > 1023 ||
        fcntl((int)number, F_GETFD) < 0) {
        return umbb_option_refuse(error, option, value, "an open descriptor from 1 to 1023");
    }
    o->progress_fd = (int)number;
    return UMB_OK;
}

/* Options that take a value. */
static const struct {
    const char *name;
    enum umb_status (*set)(struct umbb_options *, const char *option, const char *value,
                           struct umb_error *);
} valued[] = {
    {"-o", set_output},
    {"--output", set_output},
    {"--resolution", set_resolution},
    {"--max-error", set_max_error},
    {"--sun", set_sun},
    {"--light", set_light},
    {"--up", set_up},
    {"--spot", set_spot},
    {"--point", set_point},
    {"--sun-path", set_sun_path},
    {"--light-size", set_light_size},
    {"--closed", umbb_closed_set},
    {"--effect", umbb_effect_set},
    {"--threads", set_threads},
    {"--memory", set_memory},
    {"--cache", set_cache},
    {"--cache-size", set_cache_size},
    {"--from", set_from},
    {"--only", set_only},
    {"--tile", set_tile},
    {"--depth", set_depth},
    {"--verify", set_verify},
    {"--progress-fd", set_progress_fd},
    {"--sandbox", set_sandbox},
    {"--scene-buffer", set_scene_buffer},
};

/* Options without a value. */
static const struct {
    const char *name;
    size_t offset; /* of an int in struct umbb_options */
} flags[] = {
    {"--plan", offsetof(struct umbb_options, plan)},
    {"--static", offsetof(struct umbb_options, static_rule)},
    {"--json", offsetof(struct umbb_options, json)},
    {"--quiet", offsetof(struct umbb_options, quiet)},
    {"-q", offsetof(struct umbb_options, quiet)},
    {"--help", offsetof(struct umbb_options, help)},
    {"-h", offsetof(struct umbb_options, help)},
    {"--version", offsetof(struct umbb_options, version)},
};

/* Sets a flag; 0 if there is no flag of that name. */
static int take_flag(struct umbb_options *options, const char *name)
{
    for (size_t i = 0; i < sizeof flags / sizeof flags[0]; i++) {
        if (strcmp(name, flags[i].name) == 0) {
            *(int *)(void *)((char *)options + flags[i].offset) = 1;
            return 1;
        }
    }
    return 0;
}

/* Reads the option at argv[*at] with its value; moves *at to the last word used. */
static enum umb_status take_valued(struct umbb_options *options, int argc, char *const argv[],
                                   int *at, struct umb_error *error)
{
    const char *word = argv[*at];
    const char *equals = strchr(word, '=');
    const size_t length = equals != NULL ? (size_t)(equals - word) : strlen(word);
    for (size_t i = 0; i < sizeof valued / sizeof valued[0]; i++) {
        if (strlen(valued[i].name) != length || strncmp(word, valued[i].name, length) != 0 ||
            (equals != NULL && word[1] != '-')) {
            continue;
        }
        if (equals == NULL && *at + 1 >= argc) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: needs a value", valued[i].name);
        }
        const char *value = equals != NULL ? equals + 1 : argv[++*at];
        return valued[i].set(options, valued[i].name, value, error);
    }
    for (size_t i = 0; equals != NULL && i < sizeof flags / sizeof flags[0]; i++) {
        if (strlen(flags[i].name) == length && strncmp(word, flags[i].name, length) == 0) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s: takes no value", flags[i].name);
        }
    }
    return umb_fail(error, UMB_E_ARGUMENT, "unknown option '%.64s'; see --help", word);
}

/* Checks combinations of options. */
static enum umb_status check_together(struct umbb_options *o, struct umb_error *error)
{
    if (o->scene == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "SCENE: no scene file given; see --help");
    }
    if (o->task == UMBB_TASK_MERGE && o->from == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "--from: no folder of tiles given");
    }
    if (o->task != UMBB_TASK_MERGE && o->from != NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "--from: only umbrage-bake merge takes it");
    }
    if (o->task != UMBB_TASK_TILE && o->only_given) {
        return umb_fail(error, UMB_E_ARGUMENT, "--only: only umbrage-bake tile takes it");
    }
    if (o->task != UMBB_TASK_BAKE && o->cache != NULL) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--cache: the folder of tiles is one already (-o, --from)");
    }
    if ((o->task != UMBB_TASK_BAKE || o->cache != NULL) && o->depth == UMBB_DEPTH_EMBREE) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--depth: 'embree' cannot tell which triangles reach a tile, so that its "
                        "tiles cannot be kept (auto, raster, plain)");
    }
    if (o->task == UMBB_TASK_IMPORT && o->scene_buffer) {
        return umb_fail(error, UMB_E_ARGUMENT, "--scene-buffer: '%.64s' is imported already",
                        o->scene);
    }
    if (o->task == UMBB_TASK_IMPORT && o->plan) {
        return umb_fail(error, UMB_E_ARGUMENT, "--plan: umbrage-bake import only reads the scene");
    }
    if (o->output == NULL && !o->plan) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: no output file given (or --plan)");
    }
    if (o->max_error_m > 0 && o->resolution_given) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--max-error: it chooses the resolution; give one of both");
    }
    if (o->max_error_m > 0) {
        o->resolution_log2 = UMBB_RESOLUTION_LOG2_MIN; /* set once the scene is known */
    } else if (o->tile_log2 > o->resolution_log2) {
        if (o->tile_given) {
            return umb_fail(error, UMB_E_ARGUMENT, "--tile: '%u' is larger than --resolution %u",
                            1U << o->tile_log2, 1U << o->resolution_log2);
        }
        o->tile_log2 = o->resolution_log2;
    }
    return umbb_effects_settle(o, error);
}

/* Reads the task; returns the number of words it took. */
static int take_task(struct umbb_options *options, int argc, char *const argv[])
{
    static const struct {
        const char *name;
        enum umbb_task task;
    } tasks[] = {
        {"tile", UMBB_TASK_TILE}, {"merge", UMBB_TASK_MERGE}, {"import", UMBB_TASK_IMPORT}};
    for (size_t i = 0; argc > 1 && i < sizeof tasks / sizeof tasks[0]; i++) {
        if (strcmp(argv[1], tasks[i].name) == 0) {
            options->task = tasks[i].task;
            return 1;
        }
    }
    return 0;
}

enum umb_status umbb_options_parse(int argc, char *const argv[], struct umbb_options *options,
                                   struct umb_error *error)
{
    const long processors = sysconf(_SC_NPROCESSORS_ONLN);
    *options = (struct umbb_options){
        .resolution_log2 = 14,
        .threads = processors < 1                        ? 1
                   : processors > (long)UMBB_THREADS_MAX ? UMBB_THREADS_MAX
                                                         : (unsigned)processors,
        .memory_bytes = (uint64_t)4 << 30,
        .tile_log2 = 12,
        .verify_points = 1000000,
        .cache_bytes = (uint64_t)10 << 30,
        .progress_fd = -1,
    };
    int only_names = 0; /* 1 after -- */
    for (int at = 1 + take_task(options, argc, argv); at < argc; at++) {
        const char *word = argv[at];
        if (!only_names && strcmp(word, "--") == 0) {
            only_names = 1;
        } else if (!only_names && strcmp(word, "-") == 0) {
            return umb_fail(error, UMB_E_ARGUMENT,
                            "SCENE: '-' (standard input) is not a file: a scene's format is told "
                            "by its name and its parts lie beside it");
        } else if (!only_names && word[0] == '-') {
            if (!take_flag(options, word)) {
                const enum umb_status status = take_valued(options, argc, argv, &at, error);
                if (status != UMB_OK) {
                    return status;
                }
            }
        } else if (word[0] == '\0') {
            return umb_fail(error, UMB_E_ARGUMENT, "SCENE: an empty name");
        } else {
            const enum umb_status status = take_scene(options, word, error);
            if (status != UMB_OK) {
                return status;
            }
        }
    }
    return options->help || options->version ? UMB_OK : check_together(options, error);
}
