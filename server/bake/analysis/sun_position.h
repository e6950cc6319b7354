/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_BAKE_ANALYSIS_SUN_POSITION_H
#define UMBRAGE_SERVER_BAKE_ANALYSIS_SUN_POSITION_H
/*
 * Position of the sun over a place at a time, accurate to 0.01 degrees from 1900 to 2100.
 *
 * Geometric, without refraction, which lifts the sun by 0.02 degrees at an elevation of 45 and by
 * 0.5 at the horizon. Nutation, aberration and parallax are included. Universal time stands for UTC
 * and UT1, which differ by less than a second (0.004 degrees). Only additions, multiplications,
 * divisions and square roots of doubles: the same bits on every machine.
 * Source: J. Meeus, Astronomical Algorithms, 2nd edition, 1998: chapters 7 (days), 12 (sidereal
 * time), 22 (obliquity), 25 (the sun, lower accuracy); J. Meeus, Astronomical Formulae for
 * Calculators, 1982, chapter 18 (perturbations of its longitude, up to 0.006 degrees together).
 */

/* Days from 2000-01-01 12:00 to 0:00 of a Gregorian date. year: 1600 or later. */
double umbb_days_from_2000(int year, int month, int day);

/* Days by which terrestrial time is ahead of universal time: 69 seconds, the value of the 2020s. It
 * was 29 seconds in 1950. The sun moves only 0.001 degrees in 88 seconds, far less than the 0.01
 * degrees of accuracy. */
#define UMBB_TERRESTRIAL_AHEAD (69.0 / 86400.0)

/* Returns the apparent longitude of the sun on the ecliptic, in degrees, 0..360. days: days of
 * terrestrial time from 2000-01-01 12:00. */
double umbb_sun_longitude(double days);

/*
 * Computes the unit vector towards the sun.
 *
 * In:  days: days of universal time from 2000-01-01 12:00. latitude_deg, longitude_deg: north and
 *      east.
 * Out: east_north_up.
 */
void umbb_sun_towards(double days, double latitude_deg, double longitude_deg,
                      double east_north_up[3]);

#endif
