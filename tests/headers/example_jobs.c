/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/jobs.h"

static int told(void *id, const struct umb_job_status *status)
{
    if (status->has_asset) {
        memcpy(id, status->asset, UMB_ID_BYTES);
    }
    return 1;
}

static enum umb_status got(void *size, uint64_t offset, const void *bytes, size_t count,
                           uint64_t whole)
{
    (void)bytes;
    EXPECT(offset == *(uint64_t *)size && offset + count <= whole);
    *(uint64_t *)size += count;
    return UMB_OK;
}

static int example(struct umb_client *client, const char *scene)
{
    const struct umb_job_file file = {.path = "city.ply", .source = scene};
    const struct umb_job_setting settings[] = {{"resolution", "256"}, {"verify", "0"}};
    const struct umb_job_submission submission = {.scene = "city.ply",
                                                  .files = &file,
                                                  .file_count = 1,
                                                  .settings = settings,
                                                  .setting_count = 2};
    struct umb_job_submitted submitted;
    uint8_t id[UMB_ID_BYTES] = {0};
    uint64_t size = 0;
#include "jobs.1"
    EXPECT(size > 128);
    return UMB_OK;
}

int main(int argc, char **argv)
{
    struct umb_client *client = NULL;
    EXPECT(argc == 3 && umb_client_open(argv[2], NULL, &client, &error) == UMB_OK);
    const int status = example(client, argv[1]);
    umb_client_close(client);
    return example_end((enum umb_status)status);
}
