/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_CLI_OPTION_NAMES_H
#define UMBRAGE_CLI_OPTION_NAMES_H
/* Errors of the library and the daemon name fields of their structs and messages; whoever typed an
 * option hears of that. */
#include "umbrage/status.h"

/* Puts options' names in place of the fields that a message begins with: "footprint_m: 7, ..."
 * becomes "--footprint: 7, ...". Other messages stay. */
void umbc_name_options(struct umb_error *error);

/* umbc_complain, so named. */
int umbc_complain_query(const struct umb_error *error);

#endif
