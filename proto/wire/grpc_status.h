/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_GRPC_STATUS_H
#define UMBRAGE_WIRE_GRPC_STATUS_H
/* Statuses as gRPC status codes (0..16), which travel in the `grpc-status` trailer. Pure. */
#include "umbrage/status.h"

/* Returns the code that stands for a status. */
int umbw_grpc_code(enum umb_status status);

/*
 * Returns the status that stands for a code that a server sent; E_PROTOCOL beyond 0..16.
 * RESOURCE_EXHAUSTED alone is E_TOO_LARGE: asking the same again does not help. A reply with
 * grpc-retry-pushback-ms beside it means E_BUSY; libumbrage looks at that.
 */
enum umb_status umbw_grpc_status(int code);

#endif
