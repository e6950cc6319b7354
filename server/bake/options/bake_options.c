/* SPDX-License-Identifier: Apache-2.0 */
/* The options of umbrage-bake as a table, and the checks that concern several options. */
#include "bake/options/bake_options.h"

#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "base/try.h"
#include "tool/bake_settings.h"

#define AT(field) UMBU_AT(struct umbb_options, field)
#define MIB       ((uint64_t)1 << 20)
#define SIZE_MAX_ ((uint64_t)1 << 50)

static enum umb_status read_output(const struct umbu_option *option, const char *text, void *field,
                                   struct umb_error *error)
{
    if (text[0] == '\0' || strcmp(text, "-") == 0) {
        return umbu_refuse(option, text, error);
    }
    memcpy(field, &text, sizeof text);
    return UMB_OK;
}

static enum umb_status read_only(const struct umbu_option *option, const char *text, void *field,
                                 struct umb_error *error)
{
    struct umbb_options *o = field;
    const char *at = text;
    uint64_t first, last;
    bool good = umbu_read_count(&at, &first);
    last = first;
    if (good && *at == '-') {
        at++;
        good = umbu_read_count(&at, &last);
    }
    if (!good || *at != '\0' || last < first) {
        return umbu_refuse(option, text, error);
    }
    o->only_first = first;
    o->only_last = last;
    return UMB_OK;
}

static enum umb_status read_scene(const struct umbu_option *option, const char *text, void *field,
                                  struct umb_error *error)
{
    struct umbb_options *o = field;
    o->scene_buffer |= !umbu_is_word(option);
    if (text[0] == '\0' || strcmp(text, "-") == 0) {
        return umbu_refuse(option, text, error);
    }
    if (o->scene != NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "SCENE: '%.64s' is a second one after '%.64s'", text,
                        o->scene);
    }
    o->scene = text;
    return UMB_OK;
}

static enum umb_status read_descriptor(const struct umbu_option *option, const char *text,
                                       void *field, struct umb_error *error)
{
    const char *at = text;
    uint64_t value;
    if (!umbu_read_count(&at, &value) || *at != '\0' || value < 1 || value > 1023 ||
        fcntl((int)value, F_GETFD) < 0) {
        return umbu_refuse(option, text, error);
    }
    const int number = (int)value;
    memcpy(field, &number, sizeof number);
    return UMB_OK;
}

static const struct umbu_option MAIN[] = {
    {"SCENE", NULL, "a glTF, GLB, OBJ, PLY or STL file",
     UMBU_READ(read_scene, "a file: the name tells the format, and further files of the scene lie "
                           "beside the file (so - for standard input cannot be one)")},
    {"scene-buffer", "FILE",
     "instead of SCENE, in every command but import: a file that import made. It and its folder "
     "must belong to you (or root) and be writable by no one else",
     UMBU_READ(read_scene, "a file of umbrage-bake import")},
    {"output", "FILE", "the asset to write, replaced atomically",
     UMBU_READ(read_output, "a file name (a bake cannot write to stdout; name a file or folder, "
                            "./- for one of that name)"),
     AT(output), .letter = 'o'},
    {"plan", NULL, "print the plan and its reasons only", UMBU_FLAG, AT(plan)},
    {"json", NULL, "print one JSON object", UMBU_FLAG, AT(json)},
    {"quiet", NULL, "no notices, no progress, no summary", UMBU_FLAG, AT(quiet), .letter = 'q'},
    {"progress-fd", "N", "write phases, plan and progress to descriptor N, line by line",
     UMBU_READ(read_descriptor, "an open descriptor from 1 to 1023"), AT(progress_fd)},
    {"version", NULL, "the version", UMBU_FLAG, AT(version), .alone = true},
};

#define LIGHTS AT(lights)

/* Rows of tool/bake_settings.h: what the asset holds. */
static const struct umbu_option ASSET[] = {
    {UMBU_BAKE_RESOLUTION, UMBU_LOG2(64, 262144), AT(resolution_log2), .standard = "16384"},
    {UMBU_BAKE_MAX_ERROR, UMBU_ABOVE(0, HUGE_VAL), AT(max_error_m), .unit = "m",
     .excludes = "resolution"},
    {UMBU_BAKE_SUN,
     UMBU_READ(umbb_light_option_sun, "AZIMUTH,ELEVATION in degrees, -360 to 360 and 0 to 90"),
     LIGHTS},
    {UMBU_BAKE_SUN_PATH,
     UMBU_READ(umbb_light_option_path, "LATITUDE,LONGITUDE,YYYY-MM-DD,MINUTES: degrees north and "
                                       "east, years 1900 to 2100, a step of 1 to 720 minutes"),
     LIGHTS},
    {UMBU_BAKE_POINT,
     UMBU_READ(umbb_light_option_point, "X,Y,Z in metres, at most 1e12 in magnitude"), LIGHTS},
    {UMBU_BAKE_SPOT,
     UMBU_READ(umbb_light_option_spot,
               "X,Y,Z,DX,DY,DZ,DEGREES: a place, a direction that is not zero, and half of the "
               "cone's angle, above 0 and at most 90"),
     LIGHTS},
    {UMBU_BAKE_AREA,
     UMBU_READ(umbb_light_option_area,
               "X,Y,Z,DX,DY,DZ,DIAMETER or X,Y,Z,DX,DY,DZ,WIDTH,HEIGHT[,AX,AY,AZ]: a place, a "
               "direction that is not zero, sizes above 0 and at most 1000000 m, and an axis that "
               "is not zero"),
     LIGHTS},
    {UMBU_BAKE_LIGHT, UMBU_READ(umbb_light_option_name, "the name of a light"), LIGHTS},
    {UMBU_BAKE_LIGHT_SIZE,
     UMBU_READ(umbb_light_option_size,
               "a size with its unit, as 0.25m (spot and point lights, at most 1000000m) or "
               "0.53deg (directional ones, at most 90deg)"),
     LIGHTS},
    {UMBU_BAKE_UP, UMBU_CHOICE("|y|z"), AT(up)},
    {UMBU_BAKE_CLOSED, UMBU_CHOICE("auto|on|off|parts"), AT(closed)},
    {UMBU_BAKE_EFFECT,
     UMBU_READ(umbb_effect_set, "NAME=on or NAME=off, NAME one of closed, front, static, penumbra, "
                                "cut-out, blend-cut-out, transmittance; off also for mraa, voaa")},
    {UMBU_BAKE_STATIC, UMBU_FLAG, AT(static_rule)},
    {UMBU_BAKE_DEPTH, UMBU_CHOICE("auto|embree|raster|plain"), AT(depth)},
    {UMBU_BAKE_VERIFY, UMBU_COUNT(0, UMBB_VERIFY_POINTS_MAX), AT(verify_points),
     .standard = "1000000"},
};

static const struct umbu_option MACHINE[] = {
    {"threads", "N", "number of threads", UMBU_COUNT(1, UMBB_THREADS_MAX), AT(threads),
     .otherwise = "the number of processors"},
    {"memory", "SIZE", "limit of memory, for example 900MiB", UMBU_BYTES(16 * MIB, SIZE_MAX_),
     AT(memory_bytes), .standard = "4GiB"},
    {"tile", "N", "texels a side baked at a time, no more than --resolution", UMBU_LOG2(64, 65536),
     AT(tile_log2), .standard = "4096"},
    {"cache", "DIR",
     "keep the results of tiles in this folder and use those that are there: a bake that was "
     "killed goes on where it was, and after an edit only tiles that the edit reaches are baked",
     UMBU_TEXT, AT(cache)},
    {"cache-size", "SIZE",
     "limit of the folder: beyond it the least recently used results are removed; with tile: "
     "only if given",
     UMBU_BYTES(MIB, SIZE_MAX_), AT(cache_bytes), .standard = "10GiB"},
    {"only", "I | I-J",
     "with tile: only tile I, or tiles I to J, of those that --plan counts, from 0 on",
     UMBU_READ(read_only, "a tile's number, or two as 0-15"), .otherwise = "all"},
    {"from", "DIR", "with merge: the folder that tile wrote to", UMBU_TEXT, AT(from)},
    {"sandbox", NULL,
     "sandbox of the bake: the layers that this kernel has (available), every layer, else exit "
     "code 69 (required), or none (off). The importer is always in its sandbox (available)",
     UMBU_CHOICE("available|required|off"), AT(sandbox)},
};

const struct umbu_command umbb_command = {
    .name = "umbrage-bake",
    .usage = "umbrage-bake SCENE -o OUT.umb [options]\n"
             "       umbrage-bake SCENE --plan [options]\n"
             "       umbrage-bake tile SCENE -o DIR [options]\n"
             "       umbrage-bake merge SCENE --from DIR -o OUT.umb [options]\n"
             "       umbrage-bake import SCENE (-o FILE | --plan) [options]\n"
             "       umbrage-bake doctor [--json | --quiet] [--forbid FILE]...",
    .summary = "Bakes the shadows of a scene. --plan prints what would be baked and why, and\n"
               "writes nothing; tile bakes tiles and leaves their results in a folder; merge\n"
               "makes the asset of such tiles; import reads a scene once, for many bakes and\n"
               "tiles of it, or with --plan prints the hash by which assets name it; doctor\n"
               "checks this machine and the sandboxes of importer and bake.",
    .notes = "The output appears only when it is complete and has passed the comparison. An\n"
             "interrupt (SIGINT, SIGTERM, SIGQUIT) leaves the old file as it was and ends with\n"
             "75.\n"
             "\n"
             "tile and merge are units of work for any number of machines that share a folder:\n"
             "the same scene and options make the same tiles, under names that are hashes of\n"
             "what they depend on, and merging them makes the same asset as one bake. A tile\n"
             "that is there already is left alone; a merge that misses a tile, or finds one\n"
             "damaged, ends with 75 and names it.\n"
             "\n"
             "Exit codes: 0 ok, 2 usage, 65 unusable scene, 66 no input, 69 missing importer\n"
             "or sandbox, 70 failed comparison, 73 cannot create, 74 input or output error, 75\n"
             "temporary: over --memory, out of memory, a tile missing, or interrupted.",
    .sections = {{"options", UMBU_ROWS(MAIN)},
                 {"the asset", UMBU_ROWS(ASSET)},
                 {"this machine", UMBU_ROWS(MACHINE)}},
};

/* Checks the options against the task. */
static enum umb_status check_task(const struct umbb_options *o, struct umb_error *error)
{
    const int bakes = o->task == UMBB_TASK_BAKE, merges = o->task == UMBB_TASK_MERGE;
    const struct {
        int is_wrong;
        const char *text;
    } rules[] = {
        {merges && o->from == NULL,
         "--from: is needed; give the folder that umbrage-bake tile wrote to"},
        {!merges && o->from != NULL, "--from: only umbrage-bake merge takes it"},
        {o->task != UMBB_TASK_TILE && o->only_given, "--only: only umbrage-bake tile takes it"},
        {!bakes && o->cache != NULL,
         "--cache: only a bake takes it; tile and merge use the folder of -o and --from"},
        {(!bakes || o->cache != NULL) && o->depth == UMBB_DEPTH_EMBREE,
         "--depth: 'embree' cannot tell which triangles reach a tile, so its tiles cannot be kept; "
         "give auto, raster or plain"},
    };
    if (o->task == UMBB_TASK_IMPORT && o->scene_buffer) {
        return umb_fail(error, UMB_E_ARGUMENT, "--scene-buffer: '%.64s' is imported already",
                        o->scene);
    }
    for (size_t i = 0; i < sizeof rules / sizeof rules[0]; i++) {
        if (rules[i].is_wrong) {
            return umb_fail(error, UMB_E_ARGUMENT, "%s", rules[i].text);
        }
    }
    return UMB_OK;
}

/* Checks combinations of options. */
static enum umb_status check_together(struct umbb_options *o, bool tile_given,
                                      struct umb_error *error)
{
    if (o->scene == NULL) {
        return umb_fail(error, UMB_E_ARGUMENT, "SCENE: no scene file given; see --help");
    }
    UMB__TRY(check_task(o, error));
    if (o->output == NULL && !o->plan) {
        return umb_fail(error, UMB_E_ARGUMENT, "-o: no output file given (or --plan)");
    }
    if (o->max_error_m > 0) {
        o->resolution_log2 = UMBB_RESOLUTION_LOG2_MIN; /* set once the scene is known */
    } else if (o->tile_log2 > o->resolution_log2) {
        if (tile_given) {
            return umb_fail(error, UMB_E_ARGUMENT, "--tile: '%u' is larger than --resolution %u",
                            1U << o->tile_log2, 1U << o->resolution_log2);
        }
        o->tile_log2 = o->resolution_log2;
    }
    return umbb_effects_settle(o, error);
}

/* Reads the task; returns the number of words it took. */
static int take_task(struct umbb_options *options, int argc, char **argv)
{
    static const char *const tasks[] = {
        [UMBB_TASK_TILE] = "tile", [UMBB_TASK_MERGE] = "merge", [UMBB_TASK_IMPORT] = "import"};
    for (int i = UMBB_TASK_TILE; argc > 1 && i <= UMBB_TASK_IMPORT; i++) {
        if (strcmp(argv[1], tasks[i]) == 0) {
            options->task = (enum umbb_task)i;
            return 1;
        }
    }
    return 0;
}

enum umb_status umbb_options_parse(int argc, char **argv, struct umbb_options *options,
                                   struct umb_error *error)
{
    struct umbu_parsed parsed;
    *options = (struct umbb_options){
        .threads = umbu_processor_count(),
        .progress_fd = -1,
    };
    const int words = take_task(options, argc, argv);
    const enum umb_status status =
        umbu_parse(&parsed, &umbb_command, argc - words, argv + words, options, error);
    options->help = parsed.help;
    if (status != UMB_OK || parsed.help || parsed.alone != NULL) {
        return status;
    }
    options->only_given = umbu_given(&parsed, "only");
    options->cache_size_given = umbu_given(&parsed, "cache-size");
    return check_together(options, umbu_given(&parsed, "tile"), error);
}
