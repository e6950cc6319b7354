/* SPDX-License-Identifier: Apache-2.0 */
/* The rows of a command's options, completed by the table of query settings
 * (base/query_settings.h). */
#include "tool/options.h"

#include <math.h>
#include <string.h>
#include "base/query_settings.h"

bool umbu_is_among(const char *list, size_t length, const char *word, size_t word_length)
{
    for (size_t at = 0; at <= length; at++) {
        size_t end = at;
        while (end < length && list[end] != '|') {
            end++;
        }
        if (end - at == word_length && memcmp(list + at, word, word_length) == 0) {
            return true;
        }
        at = end;
    }
    return false;
}

/* True if a row of the command names the setting. */
static bool has_row(const struct umbu_command *command, const char *setting)
{
    for (size_t s = 0; s < UMBU_SECTIONS_MAX && command->sections[s].options != NULL; s++) {
        const struct umbu_section *section = &command->sections[s];
        for (size_t i = 0; i < section->count; i++) {
            const char *fields = section->options[i].fields, *own = section->options[i].setting;
            if ((own != NULL && strcmp(own, setting) == 0) ||
                (fields != NULL &&
                 umbu_is_among(fields, strlen(fields), setting, strlen(setting)))) {
                return true;
            }
        }
    }
    return false;
}

/* Makes the row of a query setting, completed by what its option gives. */
static void make_row(const struct umbu_option *option, const struct umb__setting *setting,
                     struct umbu_row *row)
{
    static const struct {
        enum umbu_kind kind;
        enum umbu_type type;
        const char *value;
    } KINDS[] = {
        [UMB__SETTING_COUNT] = {UMBU_KIND_COUNT, UMBU_TYPE_UINT, "N"},
        [UMB__SETTING_ODD] = {UMBU_KIND_ODD, UMBU_TYPE_UINT, "N"},
        [UMB__SETTING_CHOICE] = {UMBU_KIND_CHOICE, UMBU_TYPE_UINT, "NAME"},
        [UMB__SETTING_FLAG] = {UMBU_KIND_FLAG, UMBU_TYPE_INT, NULL},
        [UMB__SETTING_NUMBER] = {UMBU_KIND_NUMBER, UMBU_TYPE_DOUBLE, "N"},
        [UMB__SETTING_NUMBERS] = {UMBU_KIND_NUMBERS, UMBU_TYPE_DOUBLES, "X,Y,Z"},
    };
    const bool is_whole = setting->kind == UMB__SETTING_COUNT || setting->kind == UMB__SETTING_ODD;
    struct umbu_option *made = &row->made;
    *made = *option;
    if (option->type == UMBU_TYPE_OTHER) { /* the whole settings */
        made->at += setting->at;
        made->type = KINDS[setting->kind].type;
        made->fields = NULL;
    }
    (void)snprintf(row->name, sizeof row->name, "%s", setting->name);
    for (char *at = row->name; (at = strchr(at, '_')) != NULL;) {
        *at = '-';
    }
    made->name = option->name != NULL ? option->name : row->name;
    made->value = option->value != NULL ? option->value : KINDS[setting->kind].value;
    made->help = option->help != NULL ? option->help : setting->help;
    made->fields = made->fields != NULL ? made->fields : setting->name;
    made->kind = KINDS[setting->kind].kind;
    made->min = setting->kind == UMB__SETTING_ODD;
    if (is_whole && option->max == 0) {
        made->max = setting->most > 0 ? (uint64_t)setting->most : UINT32_MAX;
    }
    made->above = setting->kind == UMB__SETTING_NUMBER;
    made->high =
        setting->most > 0 ? setting->most / (option->scale > 0 ? option->scale : 1) : HUGE_VAL;
    made->choices = setting->words;
    made->count = 3;
}

bool umbu_next_row(const struct umbu_command *command, struct umbu_row *row)
{
    row->index += row->option != NULL;
    for (; row->section < UMBU_SECTIONS_MAX; row->section++, row->next = 0) {
        const struct umbu_section *section = &command->sections[row->section];
        row->at = section->at;
        for (; row->next < section->count; row->next++, row->next_setting = 0) {
            const struct umbu_option *option = &section->options[row->next];
            if (option->setting == NULL) {
                row->next++;
                row->option = option;
                return true;
            }
            const bool others = strcmp(option->setting, "*") == 0;
            while (row->next_setting < umb__setting_count) {
                const struct umb__setting *setting = &umb__settings[row->next_setting++];
                if (others ? !has_row(command, setting->name)
                           : strcmp(option->setting, setting->name) == 0) {
                    make_row(option, setting, row);
                    row->option = &row->made;
                    return true;
                }
            }
        }
    }
    return false;
}
