/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_CONFIG_FILE_H
#define UMBRAGE_SERVER_DAEMON_BASE_CONFIG_FILE_H
/*
 * The daemon's INI file (umbraged.conf): one `name = value` a line. Names are those of the command
 * line without their dashes; `store` and `listen` may be repeated; flags take true or false.
 *
 *     ; comment
 *     [umbraged]
 *     store = /srv/umbrage
 *     idle-timeout = 5m
 *
 * The section line may be left out. An unknown name, another section, a value that the option does
 * not take, and a repeated name are errors; the message names the line.
 */
#include "umbrage/status.h"

#define UMBD_CONFIG_LINE_MAX 198 /* bytes; libinih reads no longer ones */

/*
 * Reads a file and calls set for each name in turn.
 *
 * In:    set: returns a failure to end the reading; its message is put after the line's number.
 * Fails: E_NO_INPUT, E_PERMISSION, E_IO (the file), E_ARGUMENT (a line), a failure of set.
 */
UMB_CHECKED enum umb_status umbd_config_read(const char *path,
                                             enum umb_status (*set)(void *user, const char *name,
                                                                    const char *value,
                                                                    struct umb_error *error),
                                             void *user, struct umb_error *error);

#endif
