/* SPDX-License-Identifier: Apache-2.0 */
/* Reading the options about lights. */
#include "bake/light_options.h"

#include <math.h>
#include <string.h>

#include "bake/option_text.h"

/* The next free request, or NULL after a refusal. */
static struct umbb_light_request *add_request(struct umbb_light_requests *requests,
                                              const char *option, const char *value,
                                              struct umb_error *error)
{
    if (requests->count == UMBB_LIGHT_REQUESTS_MAX) {
        (void)umb_fail(error, UMB_E_ARGUMENT,
                       "%s: '%.64s' is one too many, at most %u lights can be asked for", option,
                       value, UMBB_LIGHT_REQUESTS_MAX);
        return NULL;
    }
    return &requests->items[requests->count++];
}

enum umb_status umbb_light_option_sun(struct umbb_light_requests *requests, const char *option,
                                      const char *value, struct umb_error *error)
{
    const char *rest;
    double azimuth, elevation;
    if (!umbb_option_number(value, &rest, &azimuth) || *rest != ',' ||
        !umbb_option_number(rest + 1, &rest, &elevation) || *rest != '\0' ||
        fabs(azimuth) > 360.0 || elevation < 0.0 || elevation > 90.0) {
        return umbb_option_refuse(error, option, value,
                                  "AZIMUTH,ELEVATION in degrees, -360 to 360 and 0 to 90");
    }
    struct umbb_light_request *request = add_request(requests, option, value, error);
    if (request == NULL) {
        return UMB_E_ARGUMENT;
    }
    *request = (struct umbb_light_request){
        .kind = UMBB_REQUEST_SUN, .azimuth_deg = azimuth, .elevation_deg = elevation};
    return UMB_OK;
}

/* Reads exactly `digits` digits, then `end`. */
static int read_digits(const char **at, int digits, char end, int *value)
{
    *value = 0;
    for (int i = 0; i < digits; i++, (*at)++) {
        if (**at < '0' || **at > '9') {
            return 0;
        }
        *value = 10 * *value + (**at - '0');
    }
    return *(*at)++ == end;
}

/* Reads YYYY-MM-DD followed by a comma. */
static int read_date(const char **at, struct umbb_sun_path *path)
{
    static const int days[] = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};
    if (!read_digits(at, 4, '-', &path->year) || !read_digits(at, 2, '-', &path->month) ||
        !read_digits(at, 2, ',', &path->day)) {
        return 0;
    }
    if (path->year < UMBB_PATH_YEAR_MIN || path->year > UMBB_PATH_YEAR_MAX || path->month < 1 ||
        path->month > 12 || path->day < 1) {
        return 0;
    }
    const int leap =
        path->year % 4 == 0 && (path->year % 100 != 0 || path->year % 400 == 0) && path->month == 2;
    return path->day <= days[path->month - 1] + leap;
}

enum umb_status umbb_light_option_path(struct umbb_light_requests *requests, const char *option,
                                       const char *value, struct umb_error *error)
{
    struct umbb_sun_path path;
    const char *at;
    if (!umbb_option_number(value, &at, &path.latitude_deg) || *at != ',' ||
        !umbb_option_number(at + 1, &at, &path.longitude_deg) || *at++ != ',' ||
        !read_date(&at, &path) || !umbb_option_number(at, &at, &path.step_minutes) || *at != '\0' ||
        fabs(path.latitude_deg) > 90.0 || fabs(path.longitude_deg) > 180.0 ||
        path.step_minutes < 1.0 || path.step_minutes > UMBB_PATH_STEP_MAX) {
        return umbb_option_refuse(error, option, value,
                                  "LATITUDE,LONGITUDE,YYYY-MM-DD,MINUTES: degrees north and east, "
                                  "years 1900 to 2100, a step of 1 to 720 minutes");
    }
    struct umbb_light_request *request = add_request(requests, option, value, error);
    if (request == NULL) {
        return UMB_E_ARGUMENT;
    }
    *request = (struct umbb_light_request){.kind = UMBB_REQUEST_PATH, .path = path};
    return UMB_OK;
}

enum umb_status umbb_light_option_name(struct umbb_light_requests *requests, const char *option,
                                       const char *value, struct umb_error *error)
{
    if (value[0] == '\0') {
        return umbb_option_refuse(error, option, value, "the name of a light");
    }
    struct umbb_light_request *request = add_request(requests, option, value, error);
    if (request == NULL) {
        return UMB_E_ARGUMENT;
    }
    *request = (struct umbb_light_request){.kind = UMBB_REQUEST_NAME, .name = value};
    return UMB_OK;
}

/* Reads exactly `count` numbers with commas between them, each at most `limit` in magnitude. */
static int read_numbers(const char *text, size_t count, double limit, double *numbers)
{
    for (size_t i = 0; i < count; i++) {
        if (!umbb_option_number(text, &text, &numbers[i]) || fabs(numbers[i]) > limit ||
            *text != (i + 1 < count ? ',' : '\0')) {
            return 0;
        }
        text++;
    }
    return 1;
}

enum umb_status umbb_light_option_spot(struct umbb_light_requests *requests, const char *option,
                                       const char *value, struct umb_error *error)
{
    double n[7];
    if (!read_numbers(value, 7, UMBB_LIGHT_AT_MAX, n) ||
        !(fabs(n[3]) + fabs(n[4]) + fabs(n[5]) > 0.0) || n[6] <= 0.0 || n[6] > 90.0) {
        return umbb_option_refuse(error, option, value,
                                  "X,Y,Z,DX,DY,DZ,DEGREES: a place, a direction that is not zero, "
                                  "and half of the cone's angle, above 0 and at most 90");
    }
    struct umbb_light_request *request = add_request(requests, option, value, error);
    if (request == NULL) {
        return UMB_E_ARGUMENT;
    }
    *request = (struct umbb_light_request){.kind = UMBB_REQUEST_SPOT,
                                           .position = {n[0], n[1], n[2]},
                                           .direction = {n[3], n[4], n[5]},
                                           .half_deg = n[6]};
    return UMB_OK;
}

enum umb_status umbb_light_option_point(struct umbb_light_requests *requests, const char *option,
                                        const char *value, struct umb_error *error)
{
    double n[3];
    if (!read_numbers(value, 3, UMBB_LIGHT_AT_MAX, n)) {
        return umbb_option_refuse(error, option, value,
                                  "X,Y,Z in metres, at most 1e12 in magnitude");
    }
    struct umbb_light_request *request = add_request(requests, option, value, error);
    if (request == NULL) {
        return UMB_E_ARGUMENT;
    }
    *request =
        (struct umbb_light_request){.kind = UMBB_REQUEST_POINT, .position = {n[0], n[1], n[2]}};
    return UMB_OK;
}

enum umb_status umbb_light_option_size(struct umbb_light_requests *requests, const char *option,
                                       const char *value, struct umb_error *error)
{
    const char *rest;
    double size;
    if (umbb_option_number(value, &rest, &size) && size >= 0.0) {
        if (strcmp(rest, "m") == 0 && size <= UMBB_LIGHT_SIZE_M_MAX) {
            requests->has_size_m = 1;
            requests->size_m = size;
            return UMB_OK;
        }
        if (strcmp(rest, "deg") == 0 && size <= UMBB_LIGHT_SIZE_DEG_MAX) {
            requests->has_size_deg = 1;
            requests->size_deg = size;
            return UMB_OK;
        }
    }
    return umbb_option_refuse(error, option, value,
                              "a size with its unit, as 0.25m (spot and point lights, at most "
                              "1000000m) or 0.53deg (directional ones, at most 90deg)");
}
