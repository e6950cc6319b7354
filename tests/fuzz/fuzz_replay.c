/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Runs a fuzz target over the files of folders, without a fuzzer. Without arguments the folders are
 * the target's seeds (tests/fuzz/seeds) and the inputs that broke it once (tests/fuzz/regress).
 * Then each file runs once more with single bytes changed, so that the target sees damaged inputs
 * even without libFuzzer. The changes come from a fixed generator.
 */
#include <dirent.h>
#include <string.h>
#include <unistd.h>

#include "fuzz.h"

#define MUTATIONS 80000 /* of all files */
#define EACH      2000  /* of one, at most */

static uint64_t random_state = 0x9e3779b97f4a7c15U;

static uint64_t next(void)
{
    random_state ^= random_state << 13;
    random_state ^= random_state >> 7;
    random_state ^= random_state << 17;
    return random_state;
}

static int replay_file(const char *path, unsigned mutations)
{
    FILE *file = fopen(path, "rb");
    if (!file) {
        (void)fprintf(stderr, "%s: cannot be opened\n", path);
        return 1;
    }
    static uint8_t bytes[1 << 20];
    size_t size = fread(bytes, 1, sizeof bytes, file);
    (void)fclose(file);
    (void)LLVMFuzzerTestOneInput(bytes, size);
    for (unsigned i = 0; i < mutations && size > 0; i++) {
        uint8_t *copy = malloc(size);
        if (!copy) {
            return 1;
        }
        memcpy(copy, bytes, size);
        for (unsigned k = 0; k <= i % 3; k++) {
            copy[next() % size] = (uint8_t)next();
        }
        (void)LLVMFuzzerTestOneInput(copy, i % 5 == 4 ? (size_t)(next() % size) : size);
        free(copy);
    }
    return 0;
}

/* Replays the files of a folder; returns -1 if there is no such folder. In: mutations: NULL: files
 * are only counted. */
static int replay_folder(const char *name, const unsigned *mutations, unsigned *files)
{
    int failed = 0;
    DIR *folder = opendir(name);
    if (!folder) {
        (void)fprintf(stderr, "%s: not a folder\n", name);
        return -1;
    }
    for (struct dirent *entry = readdir(folder); entry; entry = readdir(folder)) {
        char path[4096];
        if (entry->d_name[0] != '.' &&
            snprintf(path, sizeof path, "%s/%s", name, entry->d_name) < (int)sizeof path) {
            failed |= mutations ? replay_file(path, *mutations) : 0;
            *files += mutations == NULL;
        }
    }
    (void)closedir(folder);
    return failed;
}

/* Finds the folders of this target: the program replay_fuzz_wire has those of fuzz_wire. Missing
 * folders are left out. */
static int own_folders(const char *program, char folders[2][256], char *names[3])
{
    static const char *const kinds[] = {"seeds", "regress"};
    const char *target = strstr(program, "replay_");
    int count = 0;
    for (size_t i = 0; target && i < 2; i++) {
        const int length = snprintf(folders[i], sizeof folders[i], "tests/fuzz/%s/%s", kinds[i],
                                    target + strlen("replay_"));
        if (length < (int)sizeof folders[i] && access(folders[i], R_OK) == 0) {
            names[++count] = folders[i];
        }
    }
    return count + 1;
}

int main(int argc, char **argv)
{
    unsigned files = 0;
    int failed = 0;
    char folders[2][256];
    char *names[3] = {argv[0]};
    if (argc == 1) {
        argc = own_folders(argv[0], folders, names);
        argv = names;
    }
    for (int i = 1; i < argc; i++) {
        failed |= replay_folder(argv[i], NULL, &files);
    }
    /* All files share a fixed number of mutations, so that the whole run takes seconds. */
    const unsigned all = getenv("UMBRAGE_SHORT") ? MUTATIONS / 16 : MUTATIONS;
    const unsigned most = all / (files + 1), mutations = most < EACH ? most : EACH;
    for (int i = 1; i < argc && !failed; i++) {
        failed |= replay_folder(argv[i], &mutations, &files);
    }
    (void)printf("%u files replayed, %u changes of each\n", files, mutations);
    return failed || files == 0;
}
