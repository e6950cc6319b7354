/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_WIRE_QUERY_CHECK_H
#define UMBRAGE_WIRE_QUERY_CHECK_H
/* Checks of both directions of the QueryRequest codec, with the same messages. All fail with
 * E_ARGUMENT, naming the field. */
#include <stdbool.h>
#include "wire/messages.h"

UMB_CHECKED enum umb_status umbw_query_check_taps(uint32_t taps, struct umb_error *error);

/* Checks the dial: finite amounts, and no setting beside it that it chooses. */
UMB_CHECKED enum umb_status umbw_query_check_dial(const struct umb_dial *dial, uint32_t taps,
                                                  uint32_t level, struct umb_error *error);

/* Returns 1 if the dial requires anything. */
int umbw_query_is_dialled(const struct umb_dial *dial);

UMB_CHECKED enum umb_status umbw_query_check_bias(double bias, struct umb_error *error);
UMB_CHECKED enum umb_status umbw_query_check_origin(const double origin[3],
                                                    struct umb_error *error);

/* Checks the filter, which has the same numbers on the wire. */
UMB_CHECKED enum umb_status umbw_query_check_filter(int64_t filter, double light_extent,
                                                    struct umb_error *error);

/* In: own: points have footprints. Their values are checked with the query. */
UMB_CHECKED enum umb_status umbw_query_check_footprint(const struct umb_query_settings *settings,
                                                       bool own, struct umb_error *error);

/* In: has_eye: an eye is given. It needs the angle of its pixels. */
UMB_CHECKED enum umb_status umbw_query_check_eye(const struct umb_query_settings *settings,
                                                 bool has_eye, struct umb_error *error);

/* Checks that points for the filter FOOTPRINT have one from any source; a picture has its
 * pixels'. */
UMB_CHECKED enum umb_status umbw_query_check_has_footprint(const struct umbw_query_request *request,
                                                           struct umb_error *error);

#endif
