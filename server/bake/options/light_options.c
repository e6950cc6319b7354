/* SPDX-License-Identifier: Apache-2.0 */
/* Reading the options about lights, see light_options.h. */
#include "bake/options/light_options.h"

#include <math.h>
#include <string.h>

/* Adds a request. Fails: E_ARGUMENT (too many). */
static enum umb_status add_request(struct umbb_light_requests *requests,
                                   const struct umbb_light_request *request,
                                   const struct umbu_option *option, const char *value,
                                   struct umb_error *error)
{
    if (requests->count == UMBB_LIGHT_REQUESTS_MAX) {
        return umb_fail(error, UMB_E_ARGUMENT,
                        "--%s: '%.64s' is one too many; give at most %u lights", option->name,
                        value, UMBB_LIGHT_REQUESTS_MAX);
    }
    requests->items[requests->count++] = *request;
    return UMB_OK;
}

enum umb_status umbb_light_option_sun(const struct umbu_option *option, const char *value,
                                      void *lights, struct umb_error *error)
{
    double n[2];
    if (!umbu_read_numbers(value, 2, n) || fabs(n[0]) > 360.0 || n[1] < 0.0 || n[1] > 90.0) {
        return umbu_refuse(option, value, error);
    }
    const struct umbb_light_request request = {
        .kind = UMBB_REQUEST_SUN, .azimuth_deg = n[0], .elevation_deg = n[1]};
    return add_request(lights, &request, option, value, error);
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

enum umb_status umbb_light_option_path(const struct umbu_option *option, const char *value,
                                       void *lights, struct umb_error *error)
{
    struct umbb_sun_path path;
    const char *at = value;
    if (!umbu_read_number(&at, &path.latitude_deg) || *at++ != ',' ||
        !umbu_read_number(&at, &path.longitude_deg) || *at++ != ',' || !read_date(&at, &path) ||
        !umbu_read_number(&at, &path.step_minutes) || *at != '\0' ||
        fabs(path.latitude_deg) > 90.0 || fabs(path.longitude_deg) > 180.0 ||
        path.step_minutes < 1.0 || path.step_minutes > UMBB_PATH_STEP_MAX) {
        return umbu_refuse(option, value, error);
    }
    const struct umbb_light_request request = {.kind = UMBB_REQUEST_PATH, .path = path};
    return add_request(lights, &request, option, value, error);
}

enum umb_status umbb_light_option_name(const struct umbu_option *option, const char *value,
                                       void *lights, struct umb_error *error)
{
    if (value[0] == '\0') {
        return umbu_refuse(option, value, error);
    }
    const struct umbb_light_request request = {.kind = UMBB_REQUEST_NAME, .name = value};
    return add_request(lights, &request, option, value, error);
}

/* Reads `count` numbers with commas between them, each at most UMBB_LIGHT_AT_MAX in magnitude. */
static bool read_places(const char *text, size_t count, double *numbers)
{
    bool good = umbu_read_numbers(text, count, numbers);
    for (size_t i = 0; good && i < count; i++) {
        good = fabs(numbers[i]) <= UMBB_LIGHT_AT_MAX;
    }
    return good;
}

enum umb_status umbb_light_option_spot(const struct umbu_option *option, const char *value,
                                       void *lights, struct umb_error *error)
{
    double n[7];
    if (!read_places(value, 7, n) || !(fabs(n[3]) + fabs(n[4]) + fabs(n[5]) > 0.0) || n[6] <= 0.0 ||
        n[6] > 90.0) {
        return umbu_refuse(option, value, error);
    }
    const struct umbb_light_request request = {.kind = UMBB_REQUEST_SPOT,
                                               .position = {n[0], n[1], n[2]},
                                               .direction = {n[3], n[4], n[5]},
                                               .half_deg = n[6]};
    return add_request(lights, &request, option, value, error);
}

enum umb_status umbb_light_option_point(const struct umbu_option *option, const char *value,
                                        void *lights, struct umb_error *error)
{
    double n[3];
    if (!read_places(value, 3, n)) {
        return umbu_refuse(option, value, error);
    }
    const struct umbb_light_request request = {.kind = UMBB_REQUEST_POINT,
                                               .position = {n[0], n[1], n[2]}};
    return add_request(lights, &request, option, value, error);
}

/* Number of a list's parts: of commas, and one. */
static size_t count_parts(const char *text)
{
    size_t count = 1;
    for (; *text != '\0'; text++) {
        count += *text == ',';
    }
    return count;
}

enum umb_status umbb_light_option_area(const struct umbu_option *option, const char *value,
                                       void *lights, struct umb_error *error)
{
    double n[11] = {0};
    const size_t count = count_parts(value);
    const int is_disc = count == 7, has_axis = count == 11;
    if ((!is_disc && !has_axis && count != 8) || !read_places(value, count, n) ||
        !(fabs(n[3]) + fabs(n[4]) + fabs(n[5]) > 0.0) || !(n[6] > 0.0) ||
        n[6] > UMBB_LIGHT_SIZE_M_MAX || !(is_disc || n[7] > 0.0) || n[7] > UMBB_LIGHT_SIZE_M_MAX ||
        (has_axis && !(fabs(n[8]) + fabs(n[9]) + fabs(n[10]) > 0.0))) {
        return umbu_refuse(option, value, error);
    }
    const struct umbb_light_request request = {.kind = UMBB_REQUEST_AREA,
                                               .position = {n[0], n[1], n[2]},
                                               .direction = {n[3], n[4], n[5]},
                                               .width = is_disc ? 0.0 : n[6],
                                               .height = is_disc ? n[6] : n[7],
                                               .axis = {n[8], n[9], n[10]}};
    return add_request(lights, &request, option, value, error);
}

enum umb_status umbb_light_option_size(const struct umbu_option *option, const char *value,
                                       void *lights, struct umb_error *error)
{
    struct umbb_light_requests *requests = lights;
    const char *rest = value;
    double size;
    if (umbu_read_number(&rest, &size) && size >= 0.0) {
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
    return umbu_refuse(option, value, error);
}
