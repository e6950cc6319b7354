/* SPDX-License-Identifier: Apache-2.0 */
/* Compares the sun's position with published values; the header promises 0.01 degrees. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>

#include "bake/analysis/sun_position.h"

#define RAD_A_DEG 0.017453292519943295
#define LIMIT_DEG 0.01

/* Degrees between two angles. */
static double apart(double a, double b)
{
    return fabs(remainder(a - b, 360.0));
}

static void days_count_from_noon_of_2000(void **state)
{
    (void)state;
    assert_true(umbb_days_from_2000(2000, 1, 1) == -0.5);
    assert_true(umbb_days_from_2000(2000, 3, 1) == 59.5); /* a leap year */
    assert_true(umbb_days_from_2000(1900, 3, 1) - umbb_days_from_2000(1900, 2, 28) == 1.0);
    assert_true(umbb_days_from_2000(1957, 10, 4) == 2436115.5 - 2451545.0); /* Meeus, chapter 7 */
}

/* Instants of the equinoxes and solstices, to the minute (US Naval Observatory, Earth's Seasons);
 * half a minute is 0.0004 degrees. */
static void equinoxes_and_solstices_come_when_published(void **state)
{
    (void)state;
    static const struct {
        int year, month, day, hour, minute;
        double longitude;
    } seasons[] = {
        {2000, 3, 20, 7, 35, 0},     {2000, 6, 21, 1, 48, 90},   {2000, 9, 22, 17, 28, 180},
        {2000, 12, 21, 13, 37, 270}, {2024, 3, 20, 3, 6, 0},     {2024, 6, 20, 20, 51, 90},
        {2024, 9, 22, 12, 44, 180},  {2024, 12, 21, 9, 20, 270}, {2025, 3, 20, 9, 1, 0},
        {2025, 6, 21, 2, 42, 90},    {2025, 9, 22, 18, 19, 180}, {2025, 12, 21, 15, 3, 270},
    };
    for (size_t i = 0; i < sizeof seasons / sizeof seasons[0]; i++) {
        const double days = umbb_days_from_2000(seasons[i].year, seasons[i].month, seasons[i].day) +
                            (seasons[i].hour * 60 + seasons[i].minute) / 1440.0;
        const double longitude = umbb_sun_longitude(days + UMBB_TERRESTRIAL_AHEAD);
        if (!(apart(longitude, seasons[i].longitude) < LIMIT_DEG)) {
            fail_msg("season %zu: longitude %.5f, published %.0f", i, longitude,
                     seasons[i].longitude);
        }
    }
}

/* Meeus, Astronomical Algorithms, example 25.b: 1992 October 13, 0h dynamical time. */
static void longitude_agrees_with_the_full_theory(void **state)
{
    (void)state;
    const double published = 199.0 + 54.0 / 60.0 + 21.818 / 3600.0;
    assert_true(apart(umbb_sun_longitude(umbb_days_from_2000(1992, 10, 13)), published) <
                LIMIT_DEG);
}

/* I. Reda, A. Andreas, Solar Position Algorithm, NREL/TP-560-34302, 2008, table A5.1: Golden,
 * Colorado, 2003-10-17 12:30:30 at UTC-7; elevation without refraction. */
static void direction_agrees_with_the_solar_position_algorithm(void **state)
{
    (void)state;
    double towards[3];
    const double days = umbb_days_from_2000(2003, 10, 17) + (19.0 + 30.5 / 60.0) / 24.0;
    umbb_sun_towards(days, 39.742476, -105.1786, towards);
    const double elevation = asin(towards[2]) / RAD_A_DEG;
    const double azimuth = atan2(towards[0], towards[1]) / RAD_A_DEG;
    if (!(apart(elevation, 39.872046) < LIMIT_DEG && apart(azimuth, 194.340241) < LIMIT_DEG)) {
        fail_msg("elevation %.5f, azimuth %.5f", elevation, azimuth);
    }
}

static void directions_are_unit_and_the_poles_see_the_declination(void **state)
{
    (void)state;
    for (int day = -36000; day < 36000; day += 997) {
        double pole[3], other[3];
        umbb_sun_towards(day + 0.3, 90.0, 12.0, pole);
        umbb_sun_towards(day + 0.3, -90.0, -170.0, other);
        const double length = pole[0] * pole[0] + pole[1] * pole[1] + pole[2] * pole[2];
        assert_true(fabs(length - 1.0) < 1e-12);
        assert_true(fabs(pole[2]) < 0.3981);                          /* the tropics */
        assert_true(fabs(pole[2] + other[2] + 2.0 / 23455.0) < 2e-5); /* but for parallax */
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(days_count_from_noon_of_2000),
        cmocka_unit_test(equinoxes_and_solstices_come_when_published),
        cmocka_unit_test(longitude_agrees_with_the_full_theory),
        cmocka_unit_test(direction_agrees_with_the_solar_position_algorithm),
        cmocka_unit_test(directions_are_unit_and_the_poles_see_the_declination),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
