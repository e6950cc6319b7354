/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Words and numbers (text_number.h).
 *
 * A decimal with a mantissa below 2^53 and a power of ten up to 22 is one exact product or quotient
 * of two doubles, so it is rounded once and correctly: W. D. Clinger, How to Read Floating Point
 * Numbers Accurately, PLDI 1990. That covers nearly every number of a scene file at some 20 ns. All
 * others go to strtod; its locale is "C", because the program never calls setlocale.
 */
#include "bake/import/text_number.h"

#include <stdlib.h>
#include <string.h>

#define NUMBER_BYTES   1100 /* a double needs at most 767 significant digits */
#define MANTISSA_EXACT (1ULL << 53)
#define POWER_EXACT    22

static const double powers_of_ten[POWER_EXACT + 1] = {
    1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
    1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
};

static int is_blank(char c)
{
    return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '\\';
}

static int is_digit(char c)
{
    return c >= '0' && c <= '9';
}

int umbb_skip_blanks(struct umbb_cursor *cursor)
{
    while (cursor->at < cursor->end && is_blank(*cursor->at)) {
        cursor->at++;
    }
    return cursor->at < cursor->end;
}

int umbb_at_blank(const struct umbb_cursor *cursor)
{
    return cursor->at >= cursor->end || is_blank(*cursor->at);
}

int umbb_take_token(struct umbb_cursor *cursor, struct umbb_cursor *token)
{
    (void)umbb_skip_blanks(cursor);
    token->at = cursor->at;
    while (cursor->at < cursor->end && !is_blank(*cursor->at)) {
        cursor->at++;
    }
    token->end = cursor->at;
    return token->at < token->end;
}

int umbb_take_line(struct umbb_cursor *text, struct umbb_cursor *line)
{
    if (text->at >= text->end) {
        return 0;
    }
    const char *newline = memchr(text->at, '\n', (size_t)(text->end - text->at));
    line->at = text->at;
    line->end = newline != NULL ? newline : text->end;
    text->at = newline != NULL ? newline + 1 : text->end;
    return 1;
}

struct umbb_cursor umbb_trim(struct umbb_cursor line)
{
    while (line.at < line.end && (*line.at == ' ' || *line.at == '\t')) {
        line.at++;
    }
    while (line.at < line.end &&
           (line.end[-1] == ' ' || line.end[-1] == '\t' || line.end[-1] == '\r')) {
        line.end--;
    }
    return line;
}

int umbb_starts_with(struct umbb_cursor text, const char *start)
{
    const size_t length = strlen(start);
    return umbb_length(text) >= length && memcmp(text.at, start, length) == 0;
}

int umbb_is_word(struct umbb_cursor token, const char *word)
{
    const size_t length = umbb_length(token);
    return length == strlen(word) && memcmp(token.at, word, length) == 0;
}

/* Reads a token that the exact product does not cover. */
static int slow_double(struct umbb_cursor token, double *value)
{
    char text[NUMBER_BYTES];
    const size_t length = umbb_length(token);
    if (length == 0 || length >= sizeof(text)) {
        return 0;
    }
    memcpy(text, token.at, length);
    text[length] = '\0';
    char *end;
    *value = strtod(text, &end);
    return end == text + length;
}

/* Reads digits into the mantissa while it stays below 2^53 / 10; counts them. */
static const char *take_digits(const char *at, const char *end, uint64_t *mantissa, int *taken,
                               int *overflow)
{
    while (at < end && is_digit(*at)) {
        if (*mantissa >= MANTISSA_EXACT / 10) {
            *overflow = 1;
        } else {
            *mantissa = *mantissa * 10 + (uint64_t)(*at - '0');
        }
        (*taken)++;
        at++;
    }
    return at;
}

int umbb_take_double(struct umbb_cursor *cursor, double *value)
{
    *value = 0.0;
    if (!umbb_skip_blanks(cursor)) {
        return 0;
    }
    const char *at = cursor->at;
    const char *end = cursor->end;
    int negative = *at == '-';
    at += *at == '-' || *at == '+';
    uint64_t mantissa = 0;
    int digits = 0, overflow = 0, fraction = 0;
    at = take_digits(at, end, &mantissa, &digits, &overflow);
    if (at < end && *at == '.') {
        at = take_digits(at + 1, end, &mantissa, &fraction, &overflow);
    }
    int64_t power = 0;
    if (at < end && (*at == 'e' || *at == 'E') && digits + fraction > 0) {
        struct umbb_cursor exponent = {at + 1, end};
        if (umbb_take_integer(&exponent, &power)) {
            at = exponent.at;
        }
    }
    power -= fraction;
    if (overflow || digits + fraction == 0 || (at < end && !is_blank(*at)) ||
        power < -POWER_EXACT || power > POWER_EXACT) {
        struct umbb_cursor token;
        (void)umbb_take_token(cursor, &token);
        return slow_double(token, value);
    }
    double number = (double)mantissa;
    number = power < 0 ? number / powers_of_ten[-power] : number * powers_of_ten[power];
    *value = negative ? -number : number;
    cursor->at = at;
    return 1;
}

int umbb_take_integer(struct umbb_cursor *cursor, int64_t *value)
{
    static const int64_t most = (int64_t)1 << 62;
    const char *at = cursor->at;
    int negative = at < cursor->end && *at == '-';
    if (at < cursor->end && (*at == '-' || *at == '+')) {
        at++;
    }
    if (at >= cursor->end || !is_digit(*at)) {
        return 0;
    }
    int64_t number = 0;
    for (; at < cursor->end && is_digit(*at); at++) {
        number = number > (most - 9) / 10 ? most : number * 10 + (*at - '0');
    }
    *value = negative ? -number : number;
    cursor->at = at;
    return 1;
}
