/* SPDX-License-Identifier: Apache-2.0 */
/*
 * report.html (study_report.h): the template of study_page.html with the study's JSON and pictures
 * inserted. The page needs no network; its charts are drawn from the JSON.
 */
#include "study/study_report.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "study/study_pictures.h"

#define PATH_BYTES 4096

/* Made from study_page.html by the Makefile. */
extern const unsigned char umbt_study_template[];
extern const size_t umbt_study_template_size;

static void base64(FILE *to, const uint8_t *bytes, size_t size)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t i = 0; i < size; i += 3) {
        const size_t left = size - i;
        const uint32_t group = (uint32_t)bytes[i] << 16 |
                               (left > 1 ? (uint32_t)bytes[i + 1] << 8 : 0U) |
                               (left > 2 ? (uint32_t)bytes[i + 2] : 0U);
        putc(digits[group >> 18], to);
        putc(digits[group >> 12 & 63U], to);
        putc(left > 1 ? digits[group >> 6 & 63U] : '=', to);
        putc(left > 2 ? digits[group & 63U] : '=', to);
    }
}

/* Writes a picture file as an <img>; nothing if the file is missing. */
static void image(FILE *to, const struct umbt_study *study, const char *name, const char *label)
{
    char path[PATH_BYTES];
    uint8_t block[3 * 1024];
    if (snprintf(path, sizeof path, "%s/%s", study->options.folder, name) >= (int)sizeof path) {
        return;
    }
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return;
    }
    fprintf(to, "<figure><img alt=\"%s\" src=\"data:image/png;base64,", label);
    size_t got;
    while ((got = fread(block, 1, sizeof block, file)) > 0) {
        base64(to, block, got);
    }
    (void)fclose(file);
    fprintf(to, "\"><figcaption>%s</figcaption></figure>\n", label);
}

static void pictures(FILE *to, const struct umbt_study *study)
{
    char name[128], label[160];
    image(to, study, "pictures/traced.png", "traced: one ray a sample");
    image(to, study, "pictures/aliasing.png",
          "aliasing of one map of 4096 texels a side: blue 1/16 pixel a texel and less, white 1, "
          "red 16; grey faces away");
    for (uint32_t i = 0; i < study->result_count; i++) {
        const struct umbt_study_result *result = &study->results[i];
        for (int difference = 0; umbt_study_has_picture(result) && difference < 2; difference++) {
            umbt_study_picture_name(study, result, difference, name, sizeof name);
            (void)snprintf(label, sizeof label, "%s, %u x %u taps%s",
                           study->bakes[result->bake].name, result->taps, result->taps,
                           difference ? ", difference to the traced one" : "");
            image(to, study, name, label);
        }
    }
}

/* Writes the JSON inside a <script>. '<' is escaped; in JSON it occurs in strings only. */
static void data(FILE *to, const struct umbt_study *study)
{
    char *text = NULL;
    size_t size = 0;
    FILE *json = open_memstream(&text, &size);
    if (json == NULL) {
        fputs("null", to);
        return;
    }
    umbt_study_json(json, study);
    if (fclose(json) == 0) {
        for (size_t i = 0; i < size; i++) {
            if (text[i] == '<') {
                fputs("\\u003c", to);
            } else {
                putc(text[i], to);
            }
        }
    }
    free(text);
}

void umbt_study_page(FILE *to, const struct umbt_study *study)
{
    static const struct {
        const char *mark;
        void (*print)(FILE *to, const struct umbt_study *study);
    } marks[] = {{"@DATA@", data}, {"@PICTURES@", pictures}};
    const char *at = (const char *)umbt_study_template;
    const char *end = at + umbt_study_template_size;
    while (at < end) {
        size_t m = 0;
        while (m < sizeof marks / sizeof marks[0] &&
               ((size_t)(end - at) < strlen(marks[m].mark) ||
                memcmp(at, marks[m].mark, strlen(marks[m].mark)) != 0)) {
            m++;
        }
        if (m < sizeof marks / sizeof marks[0]) {
            marks[m].print(to, study);
            at += strlen(marks[m].mark);
        } else {
            putc(*at++, to);
        }
    }
}
