/* SPDX-License-Identifier: Apache-2.0 */
/* The version that the core was compiled as. */
#include "umbrage/version.h"

uint32_t umb_version(void)
{
    return UMB_VERSION;
}
