/* SPDX-License-Identifier: Apache-2.0 */
#ifndef UMBRAGE_SERVER_JOBS_COMMAND_WORDS_H
#define UMBRAGE_SERVER_JOBS_COMMAND_WORDS_H
/*
 * Command lines, word by word; no shell ever splits them.
 *
 *     struct umbj_words words = {0};
 *     umbj_words_add(&words, "%s", program);
 *     umbj_words_add_settings(&words, settings, tile);
 *     if (!words.failed) { run words.list }
 *     umbj_words_finish(&words);
 */
#include <stddef.h>
#include <stdint.h>

struct umbj_words {
    char **list; /* [count], then NULL; heap */
    size_t count;
    int failed; /* out of memory: words are missing */
};

/* Adds one word, formatted as by printf. */
void umbj_words_add(struct umbj_words *words, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* Adds --sandbox=MODE, for every umbrage-bake of a job. mode: NULL = required. */
void umbj_words_add_sandbox(struct umbj_words *words, const char *mode);

/* Adds a job's settings, lines of --name=value, and before them --tile=N. N is the given number of
 * texels, or the map's resolution if that is smaller; 0: no such word. */
void umbj_words_add_settings(struct umbj_words *words, const char *settings, uint32_t tile);

/* Texels along the side of a tile, as _add_settings chooses it; with --max-error an upper bound. */
unsigned long umbj_tile_edge(const char *settings, uint32_t tile);

void umbj_words_finish(struct umbj_words *words);

/* 1 if one of the lines equals `wanted`. */
int umbj_settings_have(const char *settings, const char *wanted);

#endif
