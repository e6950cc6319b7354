/* SPDX-License-Identifier: Apache-2.0 */
/* Files that an operator writes: tokens, and the daemon's config. The first byte selects the kind.
 */
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/sha256.h"
#include "daemon/base/daemon_options.h"
#include "daemon/base/tokens.h"
#include "fuzz.h"
#include "fuzz_folder.h"

#define BLANKS " \t\r\n\v\f"

/* Returns 1 if the word also occurs somewhere else on its own: then it may be a token. */
static int twice(const char *text, const char *word, size_t length)
{
    for (const char *at = text; *at != '\0';) {
        at += strspn(at, BLANKS);
        const size_t other = strcspn(at, BLANKS);
        if (at != word && other == length && memcmp(at, word, length) == 0) {
            return 1;
        }
        at += other;
    }
    return 0;
}

/* Requirements on an accepted token: it is long enough, and it gives some right. */
static void check_token(const struct umbd_token *token, size_t length)
{
    if (token != NULL) {
        FUZZ_DEMAND(length >= UMBD_TOKEN_MIN);
        FUZZ_DEMAND(token->name[0] != '\0' &&
                    memchr(token->name, '\0', sizeof token->name) != NULL);
        FUZZ_DEMAND((token->scopes & ~7U) == 0 && token->scopes != 0);
    }
}

/* Tries each word of the file as a token, and the part of it before a '#': only a whole word may be
 * accepted. */
static void check_words(struct umbd_token_set *set, const char *text)
{
    uint8_t hash[UMBD_HASH_BYTES];
    for (const char *at = text; *at != '\0';) {
        at += strspn(at, BLANKS);
        const size_t length = strcspn(at, BLANKS), cut = strcspn(at, BLANKS "#");
        umbs_sha256_bytes(at, length, hash);
        check_token(umbd_token_find(set, hash), length);
        if (cut > 0 && cut < length) {
            umbs_sha256_bytes(at, cut, hash);
            const struct umbd_token *token = umbd_token_find(set, hash);
            FUZZ_DEMAND(token == NULL || twice(text, at, cut));
        }
        at += length;
    }
    umbs_sha256_bytes("", 0, hash);
    FUZZ_DEMAND(umbd_token_find(set, hash) == NULL);
}

static void check_tokens(const char *path, const char *text)
{
    struct umbd_tokens *tokens = NULL;
    struct umb_error error = {0};
    if (umbd_tokens_create(path, &tokens, &error) != UMB_OK) {
        FUZZ_DEMAND(error.message[0] != '\0');
        return;
    }
    struct umbd_token_set *set = umbd_tokens_acquire(tokens);
    check_words(set, text);
    FUZZ_DEMAND(umbd_tokens_reload(tokens, &error) == UMB_OK);
    umbd_token_set_release(set);
    umbd_tokens_destroy(tokens);
}

/* The settings of a config file are printed so that reading the output gives the same settings. */
static void check_config(const char *path)
{
    struct umbd_options options, again;
    struct umb_error error = {0};
    char printed[512];
    char *words[] = {(char[]){"umbraged"}, (char[]){"--config"}, (char *)(uintptr_t)path, NULL};
    const enum umb_status status = umbd_options_parse(3, words, &options, &error);
    if (status == UMB_OK && !options.help && !options.version) {
        FUZZ_DEMAND(options.workers >= 1 && options.max_connections >= 1);
        (void)snprintf(printed, sizeof printed, "%s/printed", fuzz_folder());
        FILE *file = fopen(printed, "we");
        FUZZ_DEMAND(file != NULL);
        umbd_options_print(&options, file);
        (void)fclose(file);
        words[2] = printed;
        const enum umb_status second = umbd_options_parse(3, words, &again, &error);
        if (second != UMB_OK) {
            (void)fprintf(stderr, "%s\n", error.message);
        }
        FUZZ_DEMAND(second == UMB_OK);
        FUZZ_DEMAND(again.max_message == options.max_message && again.queue == options.queue);
        FUZZ_DEMAND(again.listen_count == options.listen_count);
        FUZZ_DEMAND(again.idle_timeout_ms == options.idle_timeout_ms);
        umbd_options_finish(&again);
    } else if (status != UMB_OK) {
        FUZZ_DEMAND(error.message[0] != '\0');
    }
    umbd_options_finish(&options);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char path[512];
    if (size == 0 || size > 8192) {
        return 0;
    }
    (void)snprintf(path, sizeof path, "%s/file", fuzz_folder());
    fuzz_write(path, data + 1, size - 1);
    if (data[0] % 2 == 0) {
        char *text = malloc(size);
        FUZZ_DEMAND(text != NULL);
        memcpy(text, data + 1, size - 1);
        text[size - 1] = '\0';
        check_tokens(path, text);
        free(text);
    } else {
        check_config(path);
    }
    return 0;
}
