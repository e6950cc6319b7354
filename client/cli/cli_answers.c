/* SPDX-License-Identifier: Apache-2.0 */
/* Writing answers, see cli_answers.h. */
#include "cli_answers.h"

#include <inttypes.h>
#include <string.h>
#include "tool/tool_try.h"

/* Returns true for raw answers, which go to a file. stdout then gets the JSON object only. */
static bool is_raw(const struct umbc_answers *answers)
{
    return answers->options->encoding != UMBC_ENCODING_TEXT;
}

double umbc_query_ns(const struct umbc_query_total *total)
{
    const double seconds = total->here_s + 1e-9 * (double)total->server_ns;
    const double looked = (double)total->points * (double)total->light_count;
    return looked > 0 ? 1e9 * seconds / looked : 0;
}

enum umb_status umbc_answers_begin(const struct umbc_query_options *options,
                                   struct umbc_answers *answers, struct umb_error *error)
{
    memset(answers, 0, sizeof *answers);
    answers->options = options;
    UMB__TRY(umbu_output_begin(options->out, UMBU_OUTPUT_COMMAND, &answers->output, error));
    if (options->json && !is_raw(answers)) {
        answers->json.file = answers->output.file;
        umbu_json_begin(&answers->json, NULL, '{');
        umbu_json_begin(&answers->json, options->explain ? "explanations" : "answers", '[');
    }
    return UMB_OK;
}

static float float_at(const void *values, size_t i)
{
    return ((const float *)values)[i];
}

/* Returns true if JSON has a list of lights: for several lights, or with --light all. */
static bool is_list(const struct umbc_query_options *options, size_t light_count)
{
    return light_count != 1 || options->all_lights;
}

static void put_text(FILE *file, const void *const *values, size_t light_count, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < light_count; k++) {
            (void)fprintf(file, k == 0 ? "%.9g" : " %.9g", (double)float_at(values[k], i));
        }
        (void)fputc('\n', file);
    }
}

/* Writes the answers of `count` points as JSON. In: as_list: true: each point gets an array of
 * answers, also for one light. */
static void put_json(struct umbu_json *json, const void *const *values, size_t light_count,
                     size_t count, bool as_list)
{
    for (size_t i = 0; i < count; i++) {
        if (as_list) {
            umbu_json_begin(json, NULL, '[');
        }
        for (size_t k = 0; k < light_count; k++) {
            umbu_json_rounded(json, NULL, (double)float_at(values[k], i), 9);
        }
        if (as_list) {
            umbu_json_end(json, ']');
        }
    }
}

static void end_byte(struct umbc_answers *answers)
{
    (void)fputc(answers->begun, answers->output.file);
    answers->begun = 0;
    answers->begun_bits = 0;
}

/* Writes bits. A batch may end within a byte; the next batch fills that byte. */
static void put_bits(struct umbc_answers *answers, const uint8_t *bits, size_t count)
{
    const size_t whole = answers->begun_bits == 0 ? count / 8 : 0;
    (void)fwrite(bits, 1, whole, answers->output.file);
    for (size_t i = 8 * whole; i < count; i++) {
        answers->begun |= (uint8_t)((bits[i / 8] >> i % 8 & 1) << answers->begun_bits++);
        if (answers->begun_bits == 8) {
            end_byte(answers);
        }
    }
}

static void put_raw(FILE *file, enum umb_answer_format format, const void *const *values,
                    size_t light_count, size_t count)
{
    if (light_count == 1) {
        (void)fwrite(values[0], 1, umb_answer_bytes(format, count), file);
        return;
    }
    size_t bytes = umb_answer_bytes(format, 1);
    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < light_count; k++) {
            (void)fwrite((const uint8_t *)values[k] + i * bytes, 1, bytes, file);
        }
    }
}

bool umbc_answers_put(struct umbc_answers *answers, const void *const *values, size_t light_count,
                      size_t count)
{
    FILE *file = answers->output.file;
    if (answers->options->encoding == UMBC_ENCODING_BIT) {
        put_bits(answers, values[0], count); /* bits go with one light only */
    } else if (is_raw(answers)) {
        put_raw(file, answers->options->settings.format, values, light_count, count);
    } else if (answers->options->json) {
        put_json(&answers->json, values, light_count, count,
                 is_list(answers->options, light_count));
    } else {
        put_text(file, values, light_count, count);
    }
    return !ferror(file);
}

static const char *state_name(uint32_t state)
{
    return state == 0 ? "shadowed" : state == 1 ? "lit" : "mixed";
}

/* Prints the window as rows of texels: '#' lit, '.' shadowed. */
static void explain_window(FILE *file, const struct umb_explanation *e)
{
    char row[UMB_TAPS_MAX + 1];
    uint32_t taps = e->taps < UMB_TAPS_MAX ? e->taps : UMB_TAPS_MAX;
    const struct umb_filter_info *filter = umb_filter_get_info(e->filter);
    (void)fprintf(file,
                  "  %s of %" PRIu32 " x %" PRIu32 " texels from %" PRId64 " %" PRId64
                  " at depth %" PRId64 ":\n",
                  filter->is_window && !filter->has_curve ? filter->name : "window", taps, taps,
                  e->window[0], e->window[1], e->cell[2]);
    for (uint32_t j = 0; j < taps; j++) {
        for (uint32_t i = 0; i < taps; i++) {
            row[i] = e->rows[j] >> i & 1 ? '#' : '.';
        }
        row[taps] = '\0';
        (void)fprintf(file, "    %s\n", row);
    }
}

static void explain_steps(FILE *file, const struct umb_explanation *e)
{
    size_t limit = sizeof e->steps / sizeof e->steps[0];
    for (size_t i = 0; i < e->step_count && i < limit; i++) {
        const char *where = i == 0 ? "cell" : e->steps[i].level == 0 ? "brick" : "node";
        (void)fprintf(file, "  level %2" PRIu32 ": %-8s %s %" PRIu64 "\n", e->steps[i].level,
                      state_name(e->steps[i].state), where, e->steps[i].index);
    }
}

static void explain_text(FILE *file, uint64_t number, float value, const struct umb_explanation *e)
{
    (void)fprintf(
        file, "point %" PRIu64 ": %.9g, %" PRIu32 " of %" PRIu32 " texels lit%s%s%s%s%s\n", number,
        (double)value, e->lit_taps, e->taps * e->taps, e->facing_away ? ", faces away" : "",
        e->outside ? ", outside" : "", e->before ? ", before the first voxel" : "",
        e->behind ? ", behind the last voxel" : "",
        e->undefined ? ", undefined: too far from any surface" : "");
    (void)fprintf(file, "  bias %s: moved %.6g m ", umb_bias_mode_name(e->bias_mode), e->bias_m);
    if (e->has_normal) {
        (void)fprintf(file, "along the normal, which faces the light at cosine %.4f\n", e->cosine);
    } else {
        (void)fputs("towards the light: the point has no normal\n", file);
    }
    (void)fprintf(file,
                  "  to %.9g %.9g %.9g, voxel %.6f %.6f %.6f (cell %" PRId64 " %" PRId64 " %" PRId64
                  ") of frustum %" PRIu32 ", %.6g m a %s\n",
                  e->moved[0], e->moved[1], e->moved[2], e->voxel[0], e->voxel[1], e->voxel[2],
                  e->cell[0], e->cell[1], e->cell[2], e->frustum, e->voxel_size_m,
                  e->level > 0 ? "cell" : "voxel");
    if (e->level > 0) {
        (void)fprintf(file, "  stops at cells of %u voxels a side\n", 1U << e->level);
    }
    if (umb_filter_get_info(e->filter)->has_footprints) {
        (void)fprintf(file, "  footprint of %.6g m; below, its least window\n", e->footprint_m);
    }
    if (e->transmittance < 1.0) {
        (void)fprintf(file, "  translucent casters leave %.6g of the light\n", e->transmittance);
    }
    explain_steps(file, e);
    if (e->taps > 1 && !e->facing_away) {
        explain_window(file, e);
    }
    (void)fprintf(file, "  cost: %" PRIu32 " nodes and %" PRIu32 " bricks read\n", e->nodes,
                  e->bricks);
}

static void explain_json(struct umbu_json *json, uint64_t number, float value,
                         const struct umb_explanation *e)
{
    umbu_json_begin(json, NULL, '{');
    UMBU_JSON_COUNTS(json, {"point", number}, {"lit_taps", e->lit_taps}, {"taps", e->taps},
                     {"level", e->level}, {"frustum", e->frustum}, {"nodes", e->nodes},
                     {"bricks", e->bricks});
    UMBU_JSON_VALUES(json, 17, {"answer", (double)value}, {"transmittance", e->transmittance},
                     {"bias_m", e->bias_m}, {"cosine", e->cosine},
                     {"voxel_size_m", e->voxel_size_m});
    umbu_json_bool(json, "facing_away", e->facing_away != 0);
    umbu_json_bool(json, "undefined", e->undefined != 0);
    umbu_json_bool(json, "outside", e->outside != 0);
    umbu_json_bool(json, "before", e->before != 0);
    umbu_json_bool(json, "behind", e->behind != 0);
    umbu_json_text(json, "filter", umb_filter_name(e->filter));
    if (umb_filter_get_info(e->filter)->has_footprints) {
        umbu_json_number(json, "footprint_m", e->footprint_m);
    }
    umbu_json_text(json, "bias", umb_bias_mode_name(e->bias_mode));
    umbu_json_bool(json, "has_normal", e->has_normal != 0);
    umbu_json_vector(json, "moved", e->moved);
    umbu_json_vector(json, "voxel", e->voxel);
    umbu_json_begin(json, "cell", '[');
    for (int axis = 0; axis < 3; axis++) {
        umbu_json_signed(json, NULL, e->cell[axis]);
    }
    umbu_json_end(json, ']');
    umbu_json_begin(json, "window", '[');
    umbu_json_signed(json, NULL, e->window[0]);
    umbu_json_signed(json, NULL, e->window[1]);
    umbu_json_end(json, ']');
    umbu_json_begin(json, "rows", '[');
    for (uint32_t j = 0; j < e->taps && j < UMB_TAPS_MAX; j++) {
        umbu_json_integer(json, NULL, e->rows[j]);
    }
    umbu_json_end(json, ']');
    umbu_json_begin(json, "steps", '[');
    size_t limit = sizeof e->steps / sizeof e->steps[0];
    for (size_t i = 0; i < e->step_count && i < limit; i++) {
        umbu_json_begin(json, NULL, '{');
        umbu_json_integer(json, "level", e->steps[i].level);
        umbu_json_text(json, "state", state_name(e->steps[i].state));
        umbu_json_integer(json, "index", e->steps[i].index);
        umbu_json_end(json, '}');
    }
    umbu_json_end(json, ']');
    umbu_json_end(json, '}');
}

void umbc_answers_explain(struct umbc_answers *answers, uint64_t number, float value,
                          const struct umb_explanation *explanation)
{
    if (answers->options->json) {
        explain_json(&answers->json, number, value, explanation);
    } else {
        explain_text(answers->output.file, number, value, explanation);
    }
}

static void end_json(struct umbc_answers *answers, const struct umbc_query_total *total)
{
    struct umbu_json *json = &answers->json;
    const struct umb_query_stats *stats = &total->stats;
    umbc_json_id(json, "asset", total->asset_id);
    if (!is_list(answers->options, total->light_count)) {
        umbu_json_integer(json, "light", total->lights[0]);
    } else {
        umbu_json_begin(json, "lights", '[');
        for (size_t k = 0; k < total->light_count; k++) {
            umbu_json_integer(json, NULL, total->lights[k]);
        }
        umbu_json_end(json, ']');
    }
    umbu_json_integer(json, "taps", total->taps);
    if (total->bound_m > 0) {
        umbu_json_integer(json, "level", total->level);
        umbu_json_number(json, "bound_m", total->bound_m);
    }
    if (total->row.lines > 0) {
        umbu_json_number(json, "visibility_error", total->row.visibility_error);
        umbu_json_number(json, "lines_per_point", total->row.lines);
    }
    if (total->expected_ns > 0) {
        umbu_json_number(json, "expected_ns", total->expected_ns);
    }
    umbu_json_number(json, "ns_per_point", umbc_query_ns(total));
    umbu_json_integer(json, "points", total->points);
    if (total->is_partial) {
        UMBU_JSON_COUNTS(json, {"pages_held", total->pages_held}, {"page_count", total->page_count},
                         {"exact", total->exact});
        umbu_json_number(json, "worst_error_m", total->worst_error_m);
    }
    umbu_json_begin(json, "stats", '{');
    UMBU_JSON_COUNTS(json, {"outside", stats->outside}, {"before", stats->before},
                     {"behind", stats->behind}, {"facing_away", stats->facing_away},
                     {"undefined", stats->undefined}, {"nodes", stats->nodes},
                     {"bricks", stats->bricks});
    umbu_json_end(json, '}');
    UMBU_JSON_VALUES(json, 17, {"seconds", total->seconds},
                     {"server_seconds", (double)total->server_ns * 1e-9});
    umbu_json_close(json);
}

enum umb_status umbc_answers_end(struct umbc_answers *answers, const struct umbc_query_total *total,
                                 struct umb_error *error)
{
    bool json = answers->options->json;
    if (answers->begun_bits > 0) {
        end_byte(answers);
    }
    if (json && !is_raw(answers)) {
        umbu_json_end(&answers->json, ']');
        end_json(answers, total);
    }
    UMB__TRY(umbu_output_commit(&answers->output, error));
    if (json && is_raw(answers)) {
        answers->json.file = stdout;
        umbu_json_begin(&answers->json, NULL, '{');
        end_json(answers, total);
    }
    return UMB_OK;
}

void umbc_answers_abandon(struct umbc_answers *answers)
{
    umbu_json_close(&answers->json);
    umbu_output_abandon(&answers->output);
}
