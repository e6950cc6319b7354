/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_OPTIONS_LIGHT_OPTIONS_H
#define UMBRAGE_SERVER_BAKE_OPTIONS_LIGHT_OPTIONS_H
/* Lights of the command line: --sun, --sun-path, --spot, --point, --light, and their size:
 * --light-size. */
#include <stddef.h>
#include "tool/options.h"

#define UMBB_LIGHT_REQUESTS_MAX 512U
#define UMBB_PATH_YEAR_MIN      1900 /* first year for which the sun's position is computed */
#define UMBB_PATH_YEAR_MAX      2100
#define UMBB_PATH_STEP_MAX      720.0 /* minutes */
#define UMBB_LIGHT_AT_MAX       1e12  /* metres, limit of a coordinate */
#define UMBB_LIGHT_SIZE_M_MAX   1e6
#define UMBB_LIGHT_SIZE_DEG_MAX 90.0

/* The suns of one day at one place. */
struct umbb_sun_path {
    double latitude_deg, longitude_deg; /* north and east are positive */
    int year, month, day;               /* date in the place's mean solar time, Gregorian */
    double step_minutes;
};

enum umbb_light_request_kind {
    UMBB_REQUEST_SUN = 0,
    UMBB_REQUEST_PATH = 1,
    UMBB_REQUEST_NAME = 2,
    UMBB_REQUEST_SPOT = 3,
    UMBB_REQUEST_POINT = 4,
    UMBB_REQUEST_AREA = 5,
};

/* One light option; only the fields of its kind are set. */
struct umbb_light_request {
    enum umbb_light_request_kind kind;
    double azimuth_deg, elevation_deg;
    struct umbb_sun_path path;
    const char *name;    /* borrowed from argv */
    double position[3];  /* metres, world: SPOT, POINT, AREA */
    double direction[3]; /* not zero: SPOT, AREA */
    double width;        /* metres: first side of a rectangle; 0: a disc: AREA */
    double height;       /* metres: second side, or the diameter of a disc: AREA */
    double axis[3];      /* direction of the first side; 0: level: AREA */
    double half_deg;     /* half of the cone's angle: SPOT */
};

/* All light options, in the order given. */
struct umbb_light_requests {
    size_t count;
    struct umbb_light_request items[UMBB_LIGHT_REQUESTS_MAX];
    int has_size_m, has_size_deg;
    double size_m;   /* diameter of spot and point lights */
    double size_deg; /* angular diameter of directional lights */
};

/* Readers of the options, into a struct umbb_light_requests. */
typedef enum umb_status umbb_light_option_fn(const struct umbu_option *option, const char *value,
                                             void *lights, struct umb_error *error);

umbb_light_option_fn umbb_light_option_sun, umbb_light_option_path, umbb_light_option_name,
    umbb_light_option_spot, umbb_light_option_point, umbb_light_option_area, umbb_light_option_size;

#endif
