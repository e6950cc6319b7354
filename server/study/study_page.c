/* SPDX-License-Identifier: Apache-2.0 */
/* report.html (study_report.h): study_page.html with the study's JSON and pictures. */
#include "study/study_report.h"

#include <openssl/evp.h>

#include "study/study_pictures.h"
#include "tool/report.h"

#define PATH_BYTES  4096
#define BLOCK_BYTES 3072 /* a multiple of 3: base64 of blocks is base64 of the whole */

extern const unsigned char umbu_page_study_page[];
extern const size_t umbu_page_study_page_size;

/* Writes a picture file as an <img>; nothing if the file is missing. */
static void image(FILE *to, const struct umbt_study *study, const char *name, const char *label)
{
    char path[PATH_BYTES];
    unsigned char block[BLOCK_BYTES], digits[BLOCK_BYTES / 3 * 4 + 1];
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
        (void)fwrite(digits, 1, (size_t)EVP_EncodeBlock(digits, block, (int)got), to);
    }
    (void)fclose(file);
    fprintf(to, "\"><figcaption>%s</figcaption></figure>\n", label);
}

static void put_pictures(FILE *to, const void *user)
{
    const struct umbt_study *study = user;
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

static void put_data(struct umbu_json *json, const void *user)
{
    umbt_study_put(json, user);
}

void umbt_study_page(FILE *to, const struct umbt_study *study)
{
    const struct umbu_report report = {
        .title = "umbrage: what accuracy costs",
        .page = umbu_page_study_page,
        .page_size = umbu_page_study_page_size,
        .data = put_data,
        .pictures = put_pictures,
        .user = study,
    };
    umbu_report_print(to, &report);
}
