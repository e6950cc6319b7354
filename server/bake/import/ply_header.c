/* SPDX-License-Identifier: Apache-2.0 */
/* Header of a PLY file (ply_header.h): a line is a keyword and words; limits are in the header. */
#include "bake/import/ply_header.h"

#include <string.h>

#include "bake/import/text_number.h"

#define WORDS_MAX 8 /* the longest statement has 5 words */

struct words {
    uint32_t count;
    const char *text[WORDS_MAX];
    size_t length[WORDS_MAX];
};

static void split(struct umbb_cursor line, struct words *words)
{
    words->count = 0;
    while (words->count < WORDS_MAX && umbb_skip_blanks(&line)) {
        words->length[words->count] = umbb_take_token(&line, &words->text[words->count]);
        words->count++;
    }
}

static int is_word(const struct words *words, uint32_t index, const char *word)
{
    return index < words->count && umbb_is_word(words->text[index], words->length[index], word);
}

/* Index of the word in a NULL-terminated list of names, or -1. */
static int find_word(const struct words *words, uint32_t index, const char *const *names)
{
    for (int i = 0; names[i] != NULL; i++) {
        if (is_word(words, index, names[i])) {
            return i;
        }
    }
    return -1;
}

/* Old and new names of the types alternate, in the order of enum umbb_ply_type. */
static int read_type(const struct words *words, uint32_t index, enum umbb_ply_type *type)
{
    static const char *const names[] = {
        "char",  "int8", "uchar",  "uint8", "short",   "int16",  "ushort",  "uint16", "int",
        "int32", "uint", "uint32", "float", "float32", "double", "float64", NULL,
    };
    int found = find_word(words, index, names);
    *type = (enum umbb_ply_type)(found / 2);
    return found >= 0;
}

size_t umbb_ply_type_bytes(enum umbb_ply_type type)
{
    static const size_t bytes[] = {1, 1, 2, 2, 4, 4, 4, 8};
    return bytes[type];
}

static enum umbb_ply_role find_role(const char *element, const struct words *words, uint32_t index,
                                    int is_list)
{
    static const char *const names[] = {"x", "y", "z",         "u",         "v",
                                        "s", "t", "texture_u", "texture_v", NULL};
    static const enum umbb_ply_role roles[] = {
        UMBB_PLY_X, UMBB_PLY_Y, UMBB_PLY_Z, UMBB_PLY_U, UMBB_PLY_V,
        UMBB_PLY_U, UMBB_PLY_V, UMBB_PLY_U, UMBB_PLY_V,
    };
    static const char *const lists[] = {"vertex_indices", "vertex_index", NULL};
    if (strcmp(element, "vertex") == 0 && !is_list) {
        int found = find_word(words, index, names);
        return found >= 0 ? roles[found] : UMBB_PLY_OTHER;
    }
    if (strcmp(element, "face") == 0 && is_list && find_word(words, index, lists) >= 0) {
        return UMBB_PLY_CORNERS;
    }
    return UMBB_PLY_OTHER;
}

static const char *read_property(struct umbb_ply_header *header, const struct words *words)
{
    if (header->element_count == 0) {
        return "property before any element";
    }
    struct umbb_ply_element *element = &header->elements[header->element_count - 1];
    if (element->property_count >= UMBB_PLY_PROPERTIES_MAX) {
        return "more than 128 properties in an element";
    }
    struct umbb_ply_property property = {.is_list = is_word(words, 1, "list")};
    uint32_t name = property.is_list ? 4 : 2;
    if (words->count <= name) {
        return "property without a name";
    }
    if (!read_type(words, name - 1, &property.type) ||
        (property.is_list && !read_type(words, 2, &property.count_type))) {
        return "property of an unknown type";
    }
    if (property.is_list && property.count_type >= UMBB_PLY_FLOAT32) {
        return "list whose count is no integer";
    }
    property.role = find_role(element->name, words, name, property.is_list);
    for (uint32_t i = 0; i < element->property_count; i++) {
        if (property.role != UMBB_PLY_OTHER && element->properties[i].role == property.role) {
            property.role = UMBB_PLY_OTHER; /* only the first one counts */
        }
    }
    element->properties[element->property_count++] = property;
    return NULL;
}

static const char *read_element(struct umbb_ply_header *header, const struct words *words)
{
    if (header->element_count >= UMBB_PLY_ELEMENTS_MAX) {
        return "more than 16 elements";
    }
    struct umbb_ply_element *element = &header->elements[header->element_count];
    memset(element, 0, sizeof(*element));
    int64_t count = -1;
    if (words->count >= 3) {
        struct umbb_cursor number = {words->text[2], words->text[2] + words->length[2]};
        if (!umbb_take_integer(&number, &count) || number.at != number.end) {
            count = -1;
        }
    }
    if (count < 0) {
        return "element without a name and a count";
    }
    size_t length =
        words->length[1] < sizeof(element->name) ? words->length[1] : sizeof(element->name) - 1;
    memcpy(element->name, words->text[1], length);
    element->count = (uint64_t)count;
    header->element_count++;
    return NULL;
}

static const char *read_format(struct umbb_ply_header *header, const struct words *words,
                               int *has_format)
{
    static const char *const names[] = {"ascii", "binary_little_endian", "binary_big_endian", NULL};
    int found = find_word(words, 1, names);
    if (found < 0 || !is_word(words, 2, "1.0")) {
        return "unknown format";
    }
    header->encoding = (enum umbb_ply_encoding)found;
    *has_format = 1;
    return NULL;
}

enum umb_status umbb_ply_header_read(const char *bytes, size_t size, struct umbb_ply_header *header,
                                     struct umb_error *error)
{
    struct umbb_cursor text = {bytes, bytes + size};
    struct umbb_cursor line;
    struct words words;
    int has_format = 0;
    unsigned number = 0;
    header->element_count = 0;
    header->encoding = UMBB_PLY_ASCII;
    while (umbb_take_line(&text, &line)) {
        const char *fault = NULL;
        number++;
        split(line, &words);
        if (number == 1) {
            fault = is_word(&words, 0, "ply") ? NULL : "'ply' is missing";
        } else if (is_word(&words, 0, "end_header")) {
            header->bytes = (size_t)(text.at - bytes);
            return has_format ? UMB_OK
                              : umb_fail(error, UMB_E_BAD_SCENE, "header has no format line");
        } else if (is_word(&words, 0, "format")) {
            fault = read_format(header, &words, &has_format);
        } else if (is_word(&words, 0, "element")) {
            fault = read_element(header, &words);
        } else if (is_word(&words, 0, "property")) {
            fault = read_property(header, &words);
        } else if (words.count > 0 && !is_word(&words, 0, "comment") &&
                   !is_word(&words, 0, "obj_info")) {
            fault = "unknown keyword";
        }
        if (fault != NULL) {
            return umb_fail(error, UMB_E_BAD_SCENE, "header line %u: %s", number, fault);
        }
    }
    return umb_fail(error, UMB_E_BAD_SCENE, "header has no end_header");
}

const struct umbb_ply_element *umbb_ply_find(const struct umbb_ply_header *header, const char *name)
{
    for (uint32_t i = 0; i < header->element_count; i++) {
        if (strcmp(header->elements[i].name, name) == 0) {
            return &header->elements[i];
        }
    }
    return NULL;
}
