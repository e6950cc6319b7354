/* SPDX-License-Identifier: Apache-2.0 */
#include "example.h"
#include "umbrage/version.h"

int main(void)
{
#include "version.1"
    char text[32];
    snprintf(text, sizeof text, "%d.%d.%d", UMB_VERSION_MAJOR, UMB_VERSION_MINOR,
             UMB_VERSION_PATCH);
    EXPECT(umb_version() == UMB_VERSION && strcmp(text, UMB_VERSION_TEXT) == 0);
    return 0;
}
