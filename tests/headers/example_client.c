/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/client.h"

static float local[POINTS];

static int example(void)
{
    struct umb_client_query_request request = {
        .asset = "city", .settings = {.taps = 9}, .points = example_points()};
    struct umb_client_query_reply reply;
#include "client.1"
    if (status == UMB_OK) {
        EXPECT(reply.value_bytes == sizeof values);
        example_answers(&request.settings, local);
        EXPECT(memcmp(local, values, sizeof values) == 0);
    }
    return status;
}

int main(void)
{
    return example_end((enum umb_status)example());
}
