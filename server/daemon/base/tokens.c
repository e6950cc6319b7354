/* SPDX-License-Identifier: Apache-2.0 */
/* Reading the file of tokens, and looking tokens up. */
#include "daemon/base/tokens.h"

#include <errno.h>
#include <fcntl.h>
#include <openssl/crypto.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/try.h"
#include "common/sha256.h"

#define LINE_BYTES 1024
#define RATE_MAX   1000000000000U

struct umbd_token_set {
    atomic_size_t holders;
    size_t count;
    struct umbd_token tokens[UMBD_TOKENS_MAX];
};

struct umbd_tokens {
    const char *path;
    pthread_mutex_t mutex;
    struct umbd_token_set *set; /* under the mutex; the object holds one count of it */
    atomic_uint generation;
};

static int parse_scopes(char *text, unsigned *scopes)
{
    static const struct {
        const char *name;
        unsigned scope;
    } names[] = {
        {"query", UMBD_SCOPE_QUERY}, {"submit", UMBD_SCOPE_SUBMIT}, {"admin", UMBD_SCOPE_ADMIN}};
    *scopes = 0;
    for (char *rest = text; rest != NULL;) {
        char *comma = strchr(rest, ',');
        size_t i = 0;
        if (comma != NULL) {
            *comma++ = '\0';
        }
        while (i < sizeof names / sizeof names[0] && strcmp(names[i].name, rest) != 0) {
            i++;
        }
        if (i == sizeof names / sizeof names[0]) {
            return 0;
        }
        *scopes |= names[i].scope;
        rest = comma;
    }
    return 1;
}

/* Splits text at blanks, in place, up to a word that begins with '#'. Returns the number of words,
 * at most `limit`. */
static size_t split(char *line, char **words, size_t limit)
{
    size_t count = 0;
    line[strcspn(line, "\r\n")] = '\0';
    while (count < limit) {
        line += strspn(line, " \t");
        if (line[0] == '\0' || line[0] == '#') {
            break;
        }
        words[count++] = line;
        line += strcspn(line, " \t");
        if (line[0] != '\0') {
            *line++ = '\0';
        }
    }
    return count;
}

/* Reads one line of the token file. Returns NULL, or words that say what is wrong with the line. */
static const char *take_line(struct umbd_token_set *set, char *line)
{
    char *words[5];
    size_t count = split(line, words, 5);
    if (count == 0) {
        return NULL;
    }
    for (size_t i = 0; i < count; i++) {
        if (strchr(words[i], '#') != NULL) {
            return "has a '#' inside a word: a comment begins behind a blank, a token has no '#'";
        }
    }
    if (count < 3 || count > 4) {
        return "is not NAME SCOPES TOKEN [POINTS_PER_SECOND] (scopes: query,submit,admin)";
    }
    if (set->count == UMBD_TOKENS_MAX) {
        return "is one token too many (1024)";
    }
    struct umbd_token *token = &set->tokens[set->count];
    if (strlen(words[0]) >= sizeof token->name) {
        return "has a name of more than 63 bytes";
    }
    if (!parse_scopes(words[1], &token->scopes)) {
        return "has a scope that is not query, submit or admin";
    }
    if (strlen(words[2]) < UMBD_TOKEN_MIN) {
        return "has a token of fewer than 16 characters";
    }
    if (count == 4) {
        char *end = NULL;
        errno = 0;
        token->points_per_second = strtoull(words[3], &end, 10);
        if (words[3][0] < '0' || words[3][0] > '9' || *end != '\0' || errno != 0 ||
            token->points_per_second > RATE_MAX) {
            return "has a rate that is not a number up to 10^12";
        }
    }
    memcpy(token->name, words[0], strlen(words[0]) + 1);
    umbs_sha256_bytes(words[2], strlen(words[2]), token->hash);
    set->count++;
    return NULL;
}

static enum umb_status read_set(FILE *file, const char *path, struct umbd_token_set *set,
                                struct umb_error *error)
{
    char line[LINE_BYTES];
    enum umb_status status = UMB_OK;
    for (unsigned number = 1; status == UMB_OK && fgets(line, sizeof line, file) != NULL;
         number++) {
        const char *wrong =
            strchr(line, '\n') == NULL && !feof(file) ? "is too long" : take_line(set, line);
        if (wrong != NULL) {
            status = umb_fail(error, UMB_E_ARGUMENT, "--token-file: line %u of '%.100s' %s", number,
                              path, wrong);
        }
    }
    OPENSSL_cleanse(line, sizeof line);
    return status;
}

static enum umb_status load(const char *path, struct umbd_token_set **out, struct umb_error *error)
{
    char buffer[BUFSIZ]; /* own buffer, so that no secret stays in freed memory */
    struct stat info;
    *out = NULL;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK); /* a FIFO must not block a loop */
    FILE *file = fd >= 0 ? fdopen(fd, "r") : NULL;
    if (file == NULL) {
        enum umb_status status = umb_fail_errno(error, UMB_E_NO_INPUT, errno,
                                                "--token-file: cannot open '%.100s'", path);
        if (fd >= 0) {
            close(fd);
        }
        return status;
    }
    (void)setvbuf(file, buffer, _IOFBF, sizeof buffer);
    struct umbd_token_set *set = calloc(1, sizeof *set);
    enum umb_status status = UMB_OK;
    if (set == NULL) {
        status = umb_fail(error, UMB_E_NO_MEMORY, "out of memory for tokens");
    } else if (fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        status = umb_fail(error, UMB_E_ARGUMENT, "--token-file: '%.100s' is not a file", path);
    } else if ((info.st_mode & (S_IROTH | S_IWOTH)) != 0) {
        status = umb_fail(error, UMB_E_PERMISSION,
                          "--token-file: '%.100s' may be read or written by others; chmod o-rwx it",
                          path);
    } else {
        status = read_set(file, path, set, error);
    }
    (void)fclose(file);
    OPENSSL_cleanse(buffer, sizeof buffer);
    if (status != UMB_OK) {
        free(set);
        return status;
    }
    atomic_store(&set->holders, 1);
    *out = set;
    return UMB_OK;
}

enum umb_status umbd_tokens_create(const char *path, struct umbd_tokens **out,
                                   struct umb_error *error)
{
    *out = NULL;
    struct umbd_tokens *tokens = calloc(1, sizeof *tokens);
    if (tokens == NULL) {
        return umb_fail(error, UMB_E_NO_MEMORY, "out of memory for tokens");
    }
    tokens->path = path;
    enum umb_status status = load(path, &tokens->set, error);
    if (status != UMB_OK) {
        free(tokens);
        return status;
    }
    pthread_mutex_init(&tokens->mutex, NULL);
    *out = tokens;
    return UMB_OK;
}

void umbd_tokens_destroy(struct umbd_tokens *tokens)
{
    if (tokens != NULL) {
        umbd_token_set_release(tokens->set);
        pthread_mutex_destroy(&tokens->mutex);
        free(tokens);
    }
}

enum umb_status umbd_tokens_reload(struct umbd_tokens *tokens, struct umb_error *error)
{
    struct umbd_token_set *fresh = NULL;
    UMB__TRY(load(tokens->path, &fresh, error));
    pthread_mutex_lock(&tokens->mutex);
    struct umbd_token_set *old = tokens->set;
    tokens->set = fresh;
    atomic_fetch_add(&tokens->generation, 1);
    pthread_mutex_unlock(&tokens->mutex);
    umbd_token_set_release(old);
    return UMB_OK;
}

unsigned umbd_tokens_generation(const struct umbd_tokens *tokens)
{
    return atomic_load(&tokens->generation);
}

struct umbd_token_set *umbd_tokens_acquire(struct umbd_tokens *tokens)
{
    pthread_mutex_lock(&tokens->mutex);
    struct umbd_token_set *set = tokens->set;
    atomic_fetch_add(&set->holders, 1);
    pthread_mutex_unlock(&tokens->mutex);
    return set;
}

void umbd_token_set_release(struct umbd_token_set *set)
{
    if (set != NULL && atomic_fetch_sub(&set->holders, 1) == 1) {
        free(set);
    }
}

struct umbd_token *umbd_token_find(struct umbd_token_set *set, const uint8_t hash[UMBD_HASH_BYTES])
{
    struct umbd_token *found = NULL;
    for (size_t i = 0; i < set->count; i++) {
        if (CRYPTO_memcmp(set->tokens[i].hash, hash, UMBD_HASH_BYTES) == 0) {
            found = &set->tokens[i];
        }
    }
    return found;
}
