/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/partial.h"
#include "umbrage/region.h"

/* What the example reads from its file. */
#define stored (bytes + offset)

static int example(const struct umb_file *file)
{
    const uint8_t *bytes = file->bytes, *front = bytes;
    struct umb_file_head head;
    EXPECT(umb_file_read_head(bytes, UMB_FILE_HEAD_BYTES, &head, &error) == UMB_OK);
    const size_t size = (size_t)head.open_bytes;
    const struct umb_partial_options options = {.sha256 = umb_sha256_openssl()};
    const struct umb_partial_view view = {.light = UINT32_MAX};
    const struct umb_query_settings settings = {.taps = 9};
    const struct umb_points points = example_points();
    struct umb_partial_answers answers = {.values = values};
#include "partial.1"
    EXPECT(answers.exact == POINTS);
    return UMB_OK;
}

int main(void)
{
    struct umb_file file;
    EXPECT(umb_file_open("city.umb", &file, &error) == UMB_OK);
    const int status = example(&file);
    umb_file_close(&file);
    return example_end((enum umb_status)status);
}
