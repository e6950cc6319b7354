/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_DAEMON_BASE_METHOD_H
#define UMBRAGE_SERVER_DAEMON_BASE_METHOD_H
/*
 * A method of the gRPC services: one row of the table in service/methods.c. The row gives the path,
 * the labels of the metrics, the rights, the price and the functions that answer.
 *
 * The table ends with a row without a path, for every unknown path. Its calls fail with
 * UNIMPLEMENTED.
 */
#include "daemon/base/tokens.h"

struct umbd_call;

#define UMBD_METHODS_MAX 32 /* rows of a table, the last one included */

/* Bit 0: several requests. Bit 1: several replies. */
enum umbd_method_kind {
    UMBD_UNARY = 0,
    UMBD_CLIENT_STREAM = 1,
    UMBD_SERVER_STREAM = 2,
    UMBD_BIDI_STREAM = 3,
};

/* Time at which a call is charged UMBD_CALL_POINTS. */
enum umbd_price {
    UMBD_PRICE_CALL = 0, /* When the headers are complete */
    /* With each request: the price is taken together with the request's points, in one step.
     * Charged in two steps, a call that costs more than a full second of the rate would pay the
     * first step and fail at the second. */
    UMBD_PRICE_REQUEST,
};

enum umbd_method_traits {
    UMBD_ENDLESS = 1, /* Its replies have no end: a drain fails the call */
    UMBD_UPLOAD = 2,  /* Pauses of its client add up: a slow upload must not hold a quota */
};

struct umbd_method {
    const char *path; /* "/PACKAGE.SERVICE/METHOD" */
    enum umbd_method_kind kind;
    enum umbd_scope scope; /* NONE: every caller may call it */
    enum umbd_price price;
    size_t most_bytes;                     /* Limit of a request message, 0 = --max-message */
    unsigned traits;                       /* Sum of enum umbd_method_traits */
    void (*serve)(struct umbd_call *call); /* Answers a request */
    int variant;                           /* The service's, for a `serve` of several methods */
    /* The following may be NULL. */
    void (*end)(struct umbd_call *call);   /* All requests of a stream are served */
    void (*tick)(struct umbd_call *call);  /* Ten times a second */
    void (*more)(struct umbd_call *call);  /* The client has read a part of the reply */
    void (*close)(struct umbd_call *call); /* The call ends: frees its `state` */
    /* Takes a header field that the protocol does not name. */
    void (*header)(struct umbd_call *call, const char *name, size_t name_size, const char *value,
                   size_t value_size);
    /* Gives a field for the reply's headers or trailers; *name stays NULL if there is no such
     * field. */
    void (*field)(const struct umbd_call *call, int is_trailer, const char **name,
                  const char **value);
};

static inline int umbd_takes_many(const struct umbd_method *method)
{
    return ((unsigned)method->kind & UMBD_CLIENT_STREAM) != 0;
}

static inline int umbd_gives_many(const struct umbd_method *method)
{
    return ((unsigned)method->kind & UMBD_SERVER_STREAM) != 0;
}

#endif
