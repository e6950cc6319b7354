/* SPDX-License-Identifier: Apache-2.0 */
/* Meeus's low-accuracy sun in vectors, so that no inverse trigonometric function is needed. */
#include "bake/analysis/sun_position.h"

#include <math.h>

#include "bake/analysis/light_frame.h"

#define DAYS_A_CENTURY 36525.0
/* Distance of the sun in radii of the Earth, from a parallax of 8.794 seconds of arc. */
#define SUN_DISTANCE 23455.0

static double sine(double degrees)
{
    double s, c;
    umbb_sin_cos_degrees(degrees, &s, &c);
    return s;
}

static double cosine(double degrees)
{
    double s, c;
    umbb_sin_cos_degrees(degrees, &s, &c);
    return c;
}

double umbb_days_from_2000(int year, int month, int day)
{
    /* Years count from March, so that the leap day is the last (Meeus, chapter 7). */
    const int y = month > 2 ? year : year - 1;
    const int m = month > 2 ? month : month + 12;
    const int leap = 2 - y / 100 + y / 400;
    const double julian =
        floor(365.25 * (y + 4716)) + floor(30.6001 * (m + 1)) + day + leap - 1524.5;
    return julian - 2451545.0;
}

/* Longitude of the moon's ascending node, which drives nutation. */
static double node_longitude(double t)
{
    return 125.04 - 1934.136 * t;
}

/* Returns the change of the longitude, in degrees, by Venus, Jupiter, the moon and a long period.
 * t: centuries from 2000. */
static double perturbations(double t)
{
    const double u = t + 1.0; /* centuries from 1900, as in the formulae */
    return 0.00134 * cosine(153.23 + 22518.7541 * u) + 0.00154 * cosine(216.57 + 45037.5082 * u) +
           0.00200 * cosine(312.69 + 32964.3577 * u) +
           0.00179 * sine(350.74 + u * (445267.1142 - 0.00144 * u)) +
           0.00178 * sine(231.19 + 20.20 * u);
}

double umbb_sun_longitude(double days)
{
    const double t = days / DAYS_A_CENTURY;
    const double mean = 280.46646 + t * (36000.76983 + t * 0.0003032);
    const double anomaly = 357.52911 + t * (35999.05029 - t * 0.0001537);
    const double centre = (1.914602 - t * (0.004817 + t * 0.000014)) * sine(anomaly) +
                          (0.019993 - t * 0.000101) * sine(2.0 * anomaly) +
                          0.000289 * sine(3.0 * anomaly);
    const double apparent =
        mean + centre + perturbations(t) - 0.00569 - 0.00478 * sine(node_longitude(t));
    const double turn = fmod(apparent, 360.0);
    return turn < 0.0 ? turn + 360.0 : turn;
}

static double obliquity(double t)
{
    return 23.439291111 - t * (0.013004167 + t * (1.639e-7 - t * 5.036e-7)) +
           0.00256 * cosine(node_longitude(t));
}

/* Apparent sidereal time at Greenwich, degrees. */
static double sidereal(double days, double tilt)
{
    const double t = days / DAYS_A_CENTURY;
    /* Whole days leave out the full circles of 360 degrees, to keep the digits of the rest. */
    const double whole = floor(days), part = days - whole;
    return 280.46061837 + 0.98564736629 * whole + 360.98564736629 * part +
           t * t * (0.000387933 - t / 38710000.0) -
           0.00478 * sine(node_longitude(t)) * cosine(tilt);
}

void umbb_sun_towards(double days, double latitude_deg, double longitude_deg,
                      double east_north_up[3])
{
    const double terrestrial = days + UMBB_TERRESTRIAL_AHEAD;
    const double longitude = umbb_sun_longitude(terrestrial);
    const double tilt = obliquity(terrestrial / DAYS_A_CENTURY);
    /* x towards the equinox, z towards the pole. */
    const double x = cosine(longitude);
    const double y = cosine(tilt) * sine(longitude);
    const double z = sine(tilt) * sine(longitude);
    /* Turned so that x lies in the place's meridian, y east of it. */
    const double turn = sidereal(days, tilt) + longitude_deg;
    const double south = cosine(turn) * x + sine(turn) * y;
    const double east = cosine(turn) * y - sine(turn) * x;
    const double sine_latitude = sine(latitude_deg), cosine_latitude = cosine(latitude_deg);
    east_north_up[0] = east;
    east_north_up[1] = cosine_latitude * z - sine_latitude * south;
    east_north_up[2] = cosine_latitude * south + sine_latitude * z - 1.0 / SUN_DISTANCE;
    (void)umbb_direction_normalise(east_north_up);
}
