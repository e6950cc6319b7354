/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/volume_queries.h"

static struct umb_column_answer found[POINTS];

static int example(struct umb_client *client)
{
    const struct umb_points points = example_points();
    struct umb_column_answers columns = {.columns = found};
    struct umb_volume_query_reply reply;
#include "volume_queries.1"
    int near = 0;
    for (int i = 0; i < POINTS; i++) {
        near += found[i].distance_m < 1000;
    }
    EXPECT(near > 0 && reply.stats.nodes > 0);
    return UMB_OK;
}

int main(int argc, char **argv)
{
    struct umb_client *client = NULL;
    EXPECT(argc == 3 && umb_client_open(argv[2], NULL, &client, &error) == UMB_OK);
    const int status = example(client);
    umb_client_close(client);
    return example_end((enum umb_status)status);
}
