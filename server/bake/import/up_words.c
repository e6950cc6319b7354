/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The up axis from the words of a file's comments.
 *
 * A comment that gives axes pairs letters with directions, in one of two orders: "x east, z up" or
 * "forward z, up y". The first of its words that is a letter or a direction tells the order.
 */
#include <ctype.h>
#include <string.h>

#include "bake/import/up_axis.h"

/* Bytes of a file that are searched for comments. */
#define SEARCHED_BYTES ((size_t)64 << 10)
#define WORDS_MAX      256U
#define FILLERS_MAX    3U /* words that may stand between a letter and its direction */
#define STL_HEADER     80U

/* A word of a comment: a run of letters and digits, in lower case. */
struct word {
    char text[12]; /* cut; longer words are none of those searched for */
    int negative;  /* 1: a minus sign stands before it that ends no other word */
};

static int is_one_of(const struct word *word, const char *const *list)
{
    for (; *list != NULL; list++) {
        if (strcmp(word->text, *list) == 0) {
            return 1;
        }
    }
    return 0;
}

static int is_letter(const struct word *word)
{
    return word->text[0] >= 'x' && word->text[0] <= 'z' && word->text[1] == '\0';
}

static int is_up(const struct word *word)
{
    static const char *const list[] = {"up", "upaxis", "upwards", "vertical", NULL};
    return is_one_of(word, list);
}

static int is_direction(const struct word *word)
{
    static const char *const list[] = {"forward", "front", "back", "backward", "left", "right",
                                       "north",   "south", "east", "west",     "down", NULL};
    return is_up(word) || is_one_of(word, list);
}

static int is_filler(const struct word *word)
{
    static const char *const list[] = {"axis",      "is",     "points", "pointing",
                                       "direction", "vector", NULL};
    return is_one_of(word, list);
}

/* Splits a comment into words. A letter and "up" in one word, as in "zup" or "yup", become two. */
static size_t split(struct umbb_cursor comment, struct word words[WORDS_MAX])
{
    size_t count = 0;
    while (comment.at < comment.end && count + 1 < WORDS_MAX) {
        const char *start = comment.at;
        while (comment.at < comment.end && isalnum((unsigned char)*comment.at)) {
            comment.at++;
        }
        const size_t length = (size_t)(comment.at - start);
        if (length == 0) {
            comment.at++;
            continue;
        }
        struct word *word = &words[count++];
        *word = (struct word){.text = ""};
        for (size_t i = 0; i < length && length < sizeof word->text; i++) {
            word->text[i] = (char)tolower((unsigned char)start[i]);
        }
        if (length == 3 && is_letter(&(struct word){.text = {word->text[0]}}) &&
            strcmp(word->text + 1, "up") == 0) {
            words[count++] = (struct word){.text = "up"};
            word->text[1] = '\0';
        }
        const char before = start[-1];
        word->negative = before == '-' && !isalnum((unsigned char)start[-2]);
    }
    return count;
}

/* Returns the letter paired with the "up" at `at`: the one behind it if step is 1, before it if
 * step is -1; NULL if there is none. */
static const struct word *letter_of(const struct word *words, size_t count, size_t at, int step)
{
    for (size_t i = 1; i <= FILLERS_MAX + 1; i++) {
        if (step < 0 ? at < i : at + i >= count) {
            return NULL;
        }
        const struct word *word = step < 0 ? words + at - i : words + at + i;
        if (is_letter(word)) {
            return word;
        }
        if (!is_filler(word)) {
            return NULL;
        }
    }
    return NULL;
}

static enum umbb_up join(enum umbb_up one, enum umbb_up other, int *contradiction)
{
    *contradiction |= one != UMBB_UP_UNKNOWN && other != UMBB_UP_UNKNOWN && one != other;
    return one != UMBB_UP_UNKNOWN ? one : other;
}

enum umbb_up umbb_up_of_comment(struct umbb_cursor comment)
{
    static const char blanks[] = "  ";
    char text[1026];
    struct word words[WORDS_MAX];
    /* Copies the comment behind two blanks: the code that splits words may read two bytes before
     * each word. */
    const size_t length =
        umbb_length(comment) < sizeof text - 2 ? umbb_length(comment) : sizeof text - 2;
    memcpy(text, blanks, 2);
    memcpy(text + 2, comment.at, length);
    const size_t count = split((struct umbb_cursor){text + 2, text + 2 + length}, words);
    size_t first = 0;
    while (first < count && !is_letter(&words[first]) && !is_direction(&words[first])) {
        first++;
    }
    const int step = first < count && is_letter(&words[first]) ? -1 : 1;
    enum umbb_up up = UMBB_UP_UNKNOWN;
    int contradiction = 0;
    for (size_t i = first; i < count; i++) {
        const struct word *letter = is_up(&words[i]) ? letter_of(words, count, i, step) : NULL;
        if (letter != NULL && (letter->negative || letter->text[0] == 'x')) {
            return UMBB_UP_UNKNOWN;
        }
        if (letter != NULL) {
            up = join(up, letter->text[0] == 'z' ? UMBB_UP_IS_Z : UMBB_UP_IS_Y, &contradiction);
        }
    }
    return contradiction ? UMBB_UP_UNKNOWN : up;
}

/* Programs and kinds of data that always have the same up axis. Programs that let their user choose
 * it (Blender, 3ds Max, MeshLab) are missing on purpose. */
static const struct {
    const char *name; /* lower case */
    enum umbb_up up;
} programs[] = {
    {"makehuman", UMBB_UP_IS_Y}, {"zbrush", UMBB_UP_IS_Y},       {"daz studio", UMBB_UP_IS_Y},
    {"wings 3d", UMBB_UP_IS_Y},  {"cinema 4d", UMBB_UP_IS_Y},    {"osm2world", UMBB_UP_IS_Y},
    {"openscad", UMBB_UP_IS_Z},  {"ifcopenshell", UMBB_UP_IS_Z}, {"cityjson", UMBB_UP_IS_Z},
    {"citygml", UMBB_UP_IS_Z},   {"3dfier", UMBB_UP_IS_Z},       {"epsg:", UMBB_UP_IS_Z},
};

static int contains(struct umbb_cursor text, const char *name)
{
    const size_t length = strlen(name);
    for (const char *at = text.at; umbb_length(text) >= length && at <= text.end - length; at++) {
        size_t i = 0;
        while (i < length && tolower((unsigned char)at[i]) == name[i]) {
            i++;
        }
        if (i == length) {
            return 1;
        }
    }
    return 0;
}

enum umbb_up umbb_up_of_program(struct umbb_cursor comment)
{
    for (size_t i = 0; i < sizeof programs / sizeof programs[0]; i++) {
        if (contains(comment, programs[i].name)) {
            return programs[i].up;
        }
    }
    return UMBB_UP_UNKNOWN;
}

/* Evidence from all comments of a file. */
struct said {
    enum umbb_up by_comment, by_program;
    int contradiction; /* 1: two comments name different axes */
};

static void hear(struct said *said, struct umbb_cursor comment)
{
    int ignored = 0;
    said->by_comment = join(said->by_comment, umbb_up_of_comment(comment), &said->contradiction);
    said->by_program = join(said->by_program, umbb_up_of_program(comment), &ignored);
}

/* Reads the comments of text: OBJ's lines behind '#', PLY's `comment` and `obj_info`, the name of a
 * text STL. */
static void hear_lines(struct said *said, struct umbb_cursor text, enum umbs_format format)
{
    struct umbb_cursor line, word;
    while (umbb_take_line(&text, &line)) {
        struct umbb_cursor rest = line;
        (void)umbb_take_token(&rest, &word);
        if (format == UMBS_FORMAT_PLY && umbb_is_word(word, "end_header")) {
            return;
        }
        if (format == UMBS_FORMAT_OBJ ? umbb_starts_with(word, "#")
            : format == UMBS_FORMAT_PLY
                ? umbb_is_word(word, "comment") || umbb_is_word(word, "obj_info")
                : umbb_is_word(word, "solid")) {
            hear(said, (struct umbb_cursor){word.at, line.end});
        }
    }
}

void umbb_up_decide(struct umbb_import *job)
{
    struct umbs_scene_builder *scene = &job->scene;
    struct said said = {UMBB_UP_UNKNOWN, UMBB_UP_UNKNOWN, 0};
    struct umbb_cursor text = umbb_text_of(&job->file);
    if (umbb_length(text) > SEARCHED_BYTES) {
        text.end = text.at + SEARCHED_BYTES;
    }
    if (scene->format == UMBS_FORMAT_STL && !umbb_is_text(&job->file)) {
        text.end = umbb_length(text) > STL_HEADER ? text.at + STL_HEADER : text.end;
        hear(&said, text);
    } else {
        hear_lines(&said, text, scene->format);
    }
    enum umbb_up up = said.contradiction ? UMBB_UP_UNKNOWN : said.by_comment;
    scene->up_evidence = UMBS_UP_COMMENT;
    if (up == UMBB_UP_UNKNOWN) {
        up = said.by_program;
        scene->up_evidence = UMBS_UP_PROGRAM;
    }
    if (up == UMBB_UP_UNKNOWN) {
        up = umbb_up_of_shape(scene, &scene->up_evidence);
    }
    if (up == UMBB_UP_UNKNOWN) {
        scene->up_evidence = UMBS_UP_NONE;
    }
    scene->z_up = up != UMBB_UP_IS_Y;
}
