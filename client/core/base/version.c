/* SPDX-License-Identifier: Apache-2.0 */
/* The version of the compiled core. */
#include "umbrage/version.h"

uint32_t umb_version(void)
{
    return UMB_VERSION;
}
