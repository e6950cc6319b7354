/* SPDX-License-Identifier: Apache-2.0 */
/* umbraged, with the table of its methods. */
#include "daemon/daemon.h"
#include "daemon/service/services.h"

int main(int argc, char **argv)
{
    return umbd_run(argc, argv, umbd_methods);
}
