/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_GRPC_STATUS_H
#define UMBRAGE_WIRE_GRPC_STATUS_H
/* Statuses as gRPC status codes (0..16), which travel in the `grpc-status` trailer. Pure. */
#include "umbrage/status.h"

/* Returns the gRPC code of a status. */
int umbw_grpc_code(enum umb_status status);

/*
 * Returns the status of a code that a server sent; E_PROTOCOL beyond 0..16. RESOURCE_EXHAUSTED
 * alone is E_TOO_LARGE: a retry would not help. With grpc-retry-pushback-ms it means E_BUSY, which
 * libumbrage handles.
 */
enum umb_status umbw_grpc_status(int code);

#endif
