/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"

static int example(void)
{
#include "asset.1"
    return UMB_OK;
}

int main(void)
{
    return example_end((enum umb_status)example());
}
